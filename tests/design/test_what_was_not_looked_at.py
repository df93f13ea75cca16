"""What a study says of what it did not look at, and of a cell's own design that is better than what it found."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from design.made_cells import small
from qparm.design.report import study_data, study_text
from qparm.design.study import design
from qparm.export.designs_csv import write_designs_csv

MAP: dict[str, Any] = {"method": "grid", "budget": 54, "border": 40, "workers": 1, "plans": 0}


def near(**table: Any) -> dict[str, Any]:
    """Return the cell with its workpiece where the cell's own arm covers it."""
    data = small(**table)
    data["workpiece"]["pose"]["position"] = ["0 mm", "1500 mm", "360 mm"]
    return data


def test_where_the_length_is_not_affine_the_border_is_said_not_to_have_been_followed() -> None:
    data = near(objectives=["length"], variables={"arm.lengths.L2": {"range": ["380 mm", "420 mm"]}})
    # two legs of one link: its length is the root of the sum of their squares
    data["arm"]["joints"][3]["dh"]["a"] = "100 mm"
    found = design(data, **MAP)
    assert found.least is not None
    text = study_text(found)
    assert "shortest met" in text
    assert "was not followed" in text
    assert "no shorter design in" not in text
    assert "that still does" not in text
    assert study_data(found)["border_followed"] is False


def test_the_cells_own_design_outside_the_ranges_is_said_to_be_better() -> None:
    ranges = {"arm.lengths.L1": {"range": ["500 mm", "600 mm"]}, "arm.lengths.L3": {"range": ["450 mm", "500 mm"]}}
    found = design(near(objectives=["length"], variables=ranges), **MAP)
    text = study_text(found)
    assert "no shorter design in these ranges covers the surface" in text
    assert "itself better than the recommended design in all objectives: it lies outside these ranges" in text
    assert study_data(found)["border_followed"] is True


def test_objectives_that_the_level_does_not_tell_are_named() -> None:
    found = design(near(objectives=["length", "singularity_margin"]), **MAP)
    text = study_text(found)
    assert "NOT LOOKED AT   attainable distance from singularities: not told at level reach" in text
    assert "the best in all objectives that were looked at" in text
    assert study_data(found)["objectives_not_looked_at"] == ["singularity_margin"]
    told = study_text(design(near(objectives=["length"]), **MAP))
    assert "LOOKED AT" not in told
    assert "that were looked at" not in told


def test_a_design_that_a_limit_refuses_has_a_reason(tmp_path: Path) -> None:
    found = design(near(objectives=["length"], limits={"length": "1450 mm"}), **MAP)
    write_designs_csv(found, tmp_path / "designs.csv")
    rows = list(csv.DictReader((tmp_path / "designs.csv").read_text(encoding="utf-8").splitlines()))
    refused = [row for row in rows if row["valid"] == "0" and float(row["coverage"]) == 1.0]
    assert refused
    assert all(
        "total length of the links is" in row["reason"] and "the limit 1450 mm" in row["reason"] for row in refused
    )
    assert all(row["reason"] for row in rows if row["valid"] == "0")
    assert not any(row["reason"] for row in rows if row["valid"] == "1")
