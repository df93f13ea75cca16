"""The group of commands, and how each ends."""

from __future__ import annotations

import gc
import sys
from typing import NoReturn

import click

from qparm.cli.check import check
from qparm.cli.design import design
from qparm.cli.exit_codes import FAILED, INTERRUPTED, INVALID, NOT_INSTALLED, NOT_WRITABLE
from qparm.cli.export import export
from qparm.cli.new import new
from qparm.cli.plan import plan
from qparm.cli.schema import schema
from qparm.cli.streams import forgive_streams
from qparm.cli.time import time
from qparm.cli.verify import verify
from qparm.cli.workspace import workspace
from qparm.errors import InvalidInput, OutputError, PackageMissing, QparmError, SolverUnavailable
from qparm.stopping import wait_if_ending

__all__ = ["cli", "run"]

# New objects before the garbage collector looks for cycles among them.
_OBJECTS = 50_000


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="qparm")
def cli() -> None:
    """Plan how a redundant arm covers a large curved surface.

    Start with `qparm new cell.toml`, check it with `qparm check cell.toml`, plan it with
    `qparm plan cell.toml`; `qparm design cell.toml` finds out how long the links must be. Exit codes: 0 done,
    2 invalid input, 3 done with failures, 4 cannot write, 5 something is not installed, 130 interrupted,
    143 terminated.
    """


for command in (new, check, plan, time, export, verify, workspace, design, schema):
    cli.add_command(command)


def run(arguments: list[str] | None = None) -> NoReturn:
    """Run a command and exit with its code."""
    forgive_streams()
    # what the modules make lives to the end: looking through it again and again, and once more at exit, costs half a
    # second
    gc.set_threshold(_OBJECTS, 20, 20)
    try:
        code = cli.main(args=arguments, prog_name="qparm", standalone_mode=False)
    except click.exceptions.Exit as exit_:
        code = exit_.exit_code
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except (KeyboardInterrupt, click.Abort):
        click.echo("qparm: interrupted; no file was left half written", err=True)
        code = INTERRUPTED
    except (SolverUnavailable, PackageMissing) as error:
        code = _told(error, NOT_INSTALLED)
    except OutputError as error:
        code = _told(error, NOT_WRITABLE)
    except InvalidInput as error:
        code = _told(error, INVALID)
    except QparmError as error:
        code = _told(error, INVALID if isinstance(error, ValueError) else FAILED)
    wait_if_ending()
    gc.freeze()
    sys.exit(code if isinstance(code, int) else 0)


def _told(error: Exception, code: int) -> int:
    wait_if_ending()
    click.echo(f"qparm: {error}", err=True)
    return code
