"""The command ``qparm design``."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from qparm.choices import DESIGN_METHODS, in_words
from qparm.cli import options
from qparm.cli.exit_codes import DONE_WITH_FAILURES
from qparm.cli.options import slash
from qparm.cli.progress import progress_bar
from qparm.errors import InvalidInput, PackageMissing
from qparm.files.output import require_writable
from qparm.stopping import at_stop

if TYPE_CHECKING:
    from qparm.design.journal import Journal

__all__ = ["design"]


@click.command()
@click.argument("cell", type=click.Path(path_type=Path))
@options.out_folder
@click.option(
    "--method",
    type=click.Choice(list(DESIGN_METHODS)),
    default="hybrid",
    show_default=True,
    help=in_words(DESIGN_METHODS),
)
@click.option(
    "--budget",
    type=click.IntRange(min=1),
    help="Designs to evaluate, in all.  [default: 200; grid: 41 values of each of two variables, and 100 more]",
)
@click.option(
    "--border",
    type=click.IntRange(min=0),
    help="How many of these are kept to follow the border of the valid designs to the shortest; 0: it is not followed."
    "  [default: a quarter]",
)
@click.option(
    "--level",
    type=click.Choice(["reach", "measures", "plan"]),
    help="How thoroughly each design is evaluated.  [default: measures; grid: reach]",
)
@click.option(
    "--vary",
    multiple=True,
    metavar="KEY=LOW:HIGH",
    help='A variable and its range, such as "arm.lengths.L1=480 mm:600 mm"; replaces the cell\'s, or adds to them.',
)
@click.option(
    "--plans",
    type=click.IntRange(min=0),
    default=8,
    show_default=True,
    help="How many of the best designs are planned completely at the end.",
)
@click.option("--workers", type=click.IntRange(min=1), help="Worker processes.  [default: all cores]")
@click.option("--cluster", metavar="ADDRESS", help="Evaluate on the Dask cluster with this scheduler.")
@click.option("--resume", is_flag=True, help="Continue from the journal in the output folder.")
@options.seed
@options.quiet
def design(
    cell: Path,
    out: Path,
    method: str,
    budget: int | None,
    border: int | None,
    level: str | None,
    vary: tuple[str, ...],
    plans: int,
    workers: int | None,
    cluster: str | None,
    resume: bool,
    seed: int,
    quiet: bool,
) -> int:
    """Search the designs of CELL that its [design] table allows: link lengths, travel, where the workpiece stands.

    Every finished evaluation is kept in OUT/journal.jsonl at once: an interrupted run is continued with --resume.
    """
    from qparm.design.space import DesignSpace

    space = DesignSpace.of(cell, ranges=dict(_range(text) for text in vary))
    if budget is None:
        budget, border = _default_budget(method, len(space.keys), border)
    # what is imported inside loads the kernels, or compiles them
    with progress_bar(quiet) as progress, _cluster(cluster):
        from qparm.design.journal import Journal, problem_hash
        from qparm.design.report import study_text
        from qparm.design.study import design as search
        from qparm.export.design_folder import JOURNAL_FILE, STUDY_FILES, write_study

        if plans or level == "plan":
            # here, where it is seen, and once: what is compiled is there for all workers
            from qparm.timing import kernels as _kernels  # noqa: F401
            from qparm.timing import speed_kernels as _speed_kernels  # noqa: F401

        require_writable(out, STUDY_FILES)
        # whoever forgets --resume must not lose a night's work: an old journal is set aside once there is a new line
        journal = Journal(problem_hash(space, seed), out / JOURNAL_FILE, anew=not resume)
        if resume and not quiet:
            click.echo(_journal_line(journal), err=True)
        _quiet_clearing_up()
        with at_stop(lambda: _kept(journal)), at_stop(_end_workers):
            study = search(
                space,
                method=method,
                budget=budget,
                border=border,
                level=level,
                seed=seed,
                workers=workers,
                journal=journal,
                plans=plans,
                progress=progress,
            )
            names = write_study(study, out)
    if not quiet:
        click.echo(study_text(study))
        click.echo(f"\nwritten to {out}{slash(out)}: {', '.join(names)}, {JOURNAL_FILE}")
        if study.chosen is not None:
            click.echo(f"next: qparm plan {out / 'chosen.toml'}")
    return 0 if study.least is not None else DONE_WITH_FAILURES


def _default_budget(method: str, d: int, border: int | None) -> tuple[int, int | None]:
    """Return the budget, and what of it is kept for the border: for a grid a whole map beside that."""
    if method != "grid" or d > 2:
        return 200, border
    rest = 1 + 2 * d
    kept = 100 - rest if border is None else border
    return 41**d + kept + rest, kept


def _journal_line(journal: Journal) -> str:
    """Return what a journal holds that a run goes on from."""
    from qparm.design.journal import set_aside

    file = journal.file
    assert file is not None
    mine, others = len(journal.known), journal.others
    line = f"journal: {mine + others} {_plural('evaluation', mine + others)}, {mine} of this problem"
    if others:
        line += f" ({others} of another cell, seed, version or other variables)"
    if journal.torn:
        line += f"; {journal.torn} torn {_plural('line', journal.torn)} passed over"
    earlier = set_aside(file)
    if earlier:
        names = ", ".join(other.name for other in earlier)
        line += f"; earlier journals there: {names} (to go on from one of them, name it {file.name})"
    return line


def _plural(word: str, count: int) -> str:
    return word if count == 1 else f"{word}s"


def _kept(journal: Journal) -> str:
    """Return what is said where a run is ended: that nothing finished is lost."""
    kept = len(journal.known)
    if not kept:
        return ""
    return f"{kept} finished {_plural('design', kept)} kept in {journal.file}; --resume goes on from there"


def _quiet_clearing_up() -> None:
    """Let the process that clears up after joblib's workers do so without a word, should this one be ended."""
    known = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, [known, "ignore:resource_tracker:UserWarning"]))


def _end_workers() -> None:
    """Kill the processes that evaluate designs: what they have not finished is done again by --resume."""
    processes = sys.modules.get("multiprocessing")
    for process in processes.active_children() if processes is not None else ():
        if process.pid is not None:
            os.kill(process.pid, signal.SIGTERM)


def _range(text: str) -> tuple[str, tuple[str, str]]:
    key, equals, values = text.partition("=")
    low, colon, high = values.partition(":")
    if not (key.strip() and equals and colon):
        raise InvalidInput(f'--vary {text!r}: write it such as "arm.lengths.L1=480 mm:600 mm"')
    return key.strip(), (low.strip(), high.strip())


@contextlib.contextmanager
def _cluster(address: str | None) -> Iterator[None]:
    """Evaluate on a Dask cluster inside."""
    if address is None:
        yield
        return
    try:
        import joblib
        from distributed import Client
    except ImportError:
        raise PackageMissing("distributed", "--workers, or pip install 'qparm[cluster]'") from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise InvalidInput(f"--cluster {address!r}: no scheduler answers there ({error})") from None
    with client, joblib.parallel_config(backend="dask"):
        yield
