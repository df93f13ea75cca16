"""``qparm new``: a commented cell to start from."""

from __future__ import annotations

from pathlib import Path

import click

from qparm.files.output import staged_file

__all__ = ["new"]


@click.command()
@click.argument("file", type=click.Path(path_type=Path), default=Path("cell.toml"))
def new(file: Path) -> int:
    """Write a commented cell to start from to FILE (default cell.toml)."""
    from importlib.resources import files

    text = files("qparm.cell").joinpath("new_cell.toml").read_text(encoding="utf-8")
    with staged_file(file, new=True) as staging:
        staging.write_text(text, encoding="utf-8")
    click.echo(f"written: {file}\nnext: qparm check {file}")
    return 0
