"""Cells that a design study is quick on."""

from __future__ import annotations

from typing import Any

from conftest import few_rows


def small(**design: Any) -> dict[str, Any]:
    """Return a piece of the reference cell, three rows of eleven points far enough away that short arms miss some."""
    data = few_rows()
    data["workpiece"]["pose"]["position"] = ["0 mm", "1900 mm", "360 mm"]
    data["design"] |= design
    return data
