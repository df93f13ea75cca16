"""The JSON schema of cell files takes the cells that are cells, and names what is none."""

from __future__ import annotations

import json
import re
import tomllib
from typing import Any

import pytest
from click.testing import CliRunner

from conftest import ROOT, cell_data
from qparm.cli.commands import cli

_TYPES = {"string": str, "object": dict, "array": list, "boolean": bool, "integer": int, "number": (int, float)}


@pytest.fixture(scope="module")
def schema() -> dict[str, Any]:
    run = CliRunner().invoke(cli, ["schema"])
    assert run.exit_code == 0
    return json.loads(run.output)


def fits(schema: dict[str, Any], value: Any, part: dict[str, Any]) -> bool:
    """Return whether a value is what a part of a schema asks for, as far as cells use the language."""
    if "$ref" in part:
        return fits(schema, value, schema["$defs"][part["$ref"].rsplit("/", 1)[1]])
    for several in ("anyOf", "oneOf"):
        if several in part and not any(fits(schema, value, one) for one in part[several]):
            return False
    if part.get("type") == "null":
        return value is None
    if "type" in part and not isinstance(value, _TYPES[part["type"]]):
        return False
    if ("const" in part and value != part["const"]) or ("enum" in part and value not in part["enum"]):
        return False
    if isinstance(value, str) and "pattern" in part:
        return re.search(part["pattern"], value) is not None
    if isinstance(value, dict):
        known, others = part.get("properties", {}), part.get("additionalProperties", True)
        if not set(part.get("required", ())) <= set(value):
            return False
        return all(
            fits(schema, one, known[key]) if key in known
            else others is True or (isinstance(others, dict) and fits(schema, one, others))
            for key, one in value.items()
        )  # fmt: skip
    if isinstance(value, list):
        ahead = part.get("prefixItems", [])
        rest = part.get("items", {})
        return all(
            fits(schema, one, ahead[k] if k < len(ahead) else rest if isinstance(rest, dict) else {})
            for k, one in enumerate(value)
        )
    return True


@pytest.mark.parametrize("name", ["dome", "reconfiguration", "six_axis", "elsewhere"])
def test_every_example_fits(schema: dict[str, Any], name: str) -> None:
    cell = tomllib.loads((ROOT / "examples" / f"{name}.toml").read_text(encoding="utf-8"))
    assert fits(schema, cell, schema)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("process", "feed"), 20),
        (("process", "feed"), "20"),
        (("process", "rows"), "15"),
        (("process", "fed"), "20 mm/s"),
        (("workpiece", "shape"), "cube"),
        (("arm", "convention"), "other"),
    ],
)
def test_what_is_no_cell_does_not(schema: dict[str, Any], path: tuple[str, str], value: Any) -> None:
    data = cell_data()
    assert fits(schema, data, schema)
    data[path[0]][path[1]] = value
    assert not fits(schema, data, schema)
