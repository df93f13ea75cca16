"""The designs of a study as CSV: one line per design, in the order in which they were asked for."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.cell.design import MEASURES
from qparm.design.evaluate import LEVELS
from qparm.design.report import beyond_limits
from qparm.units import SI_UNITS

if TYPE_CHECKING:
    from qparm.design.study import DesignStudy

__all__ = ["write_designs_csv"]


def write_designs_csv(study: DesignStudy, file: Path) -> None:
    """Write ``design``, the variables, level, valid, violation, coverage, missed, checked, front and the measures.

    SI, the unit in every column's name; numbers read back to the same bits; what is not known is empty:
    ``valid`` of a design that covers the surface but whose limits on measures were not looked at, too. The file is the
    same for any number of workers.
    """
    names = [name for name in MEASURES if any(name in one.measures for one in study.evaluations)]
    extra = sorted({name for one in study.evaluations for name in one.measures} - set(names))
    units = [f"[{SI_UNITS[dimension]}]" for dimension in study.space.dimensions]
    header = [
        "design",
        *(key + unit for key, unit in zip(study.space.keys, units, strict=True)),
        "level",
        "valid",
        "violation",
        "coverage",
        "missed",
        "checked",
        "front",
        *(name + (f"[{SI_UNITS[d]}]" if (d := MEASURES[name].dimension) else "") for name in names),
        *extra,
        "reason",
    ]
    front = set(study.front)
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(header)
        for place, one in enumerate(study.evaluations):
            valid = study.valid(one)
            writer.writerow(
                [
                    place,
                    *(repr(value) for value in one.x),
                    LEVELS[one.level],
                    "" if valid is None else int(valid),
                    "" if valid is None else repr(study.violation(one)),
                    repr(one.coverage),
                    one.missed,
                    one.checked,
                    int(place in front),
                    *(repr(one.measures[name]) if name in one.measures else "" for name in [*names, *extra]),
                    one.reason or beyond_limits(study, one),
                ]
            )
