"""``qparm schema``: the JSON schema of cell files, for editors."""

from __future__ import annotations

import click

__all__ = ["schema"]


@click.command()
def schema() -> int:
    """Print the JSON schema of cell files, by which editors complete and check them.

    It has keys, types and units; what else is wrong with a cell is told by `qparm check`.
    """
    import json

    from qparm.cell import Cell

    named = {"$schema": "https://json-schema.org/draft/2020-12/schema", **Cell.model_json_schema()}
    click.echo(json.dumps(named, indent=2))
    return 0
