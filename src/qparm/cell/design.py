"""The ``[design]`` table: what of a cell may be chosen, the variables named by their path in the cell.

A variable is a quantity of the cell, such as ``arm.lengths.L1`` or ``workpiece.pose.position[1]``. Entries of a list
are named by their index, joints by their name too: ``arm.joints.d1.position[1]`` is how far the rail goes.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from pydantic import Field, ValidationInfo, field_validator

from qparm.cell.part import Part
from qparm.cell.quantities import problem, quantity
from qparm.units import Dimension, format_quantity

__all__ = [
    "MEASURES",
    "Design",
    "DesignVariable",
    "Measure",
    "changed",
    "dimension_of_key",
    "own_value",
    "wrong_design",
]


@dataclass(frozen=True)
class Measure:
    """A figure of a design.

    Attributes
    ----------
    sense : {1, -1}
        1: the smaller the better; -1: the larger.
    dimension : Dimension or None
    level : int
        The level that tells it (:data:`qparm.design.evaluate.LEVELS`): 0 without any inverse kinematics, 3 from samples
        of all points' solutions, 4 from a whole plan.
    words : str
        What it is, for tables and pictures.
    """

    sense: int
    dimension: Dimension | None
    level: int
    words: str


MEASURES = {
    "length": Measure(1, "length", 0, "total length of the links"),
    "singularity_margin": Measure(-1, None, 3, "attainable distance from singularities"),
    "limit_margin": Measure(-1, None, 3, "attainable distance from joint limits"),
    "lever": Measure(1, "length", 3, "lever arms of the process force, attainable"),
    "compliance": Measure(1, "compliance", 3, "attainable compliance along the surface's normal"),
    "reconfigurations": Measure(1, None, 3, "unavoidable reconfigurations inside rows"),
    "row_end_reconfigurations": Measure(1, None, 3, "unavoidable reconfigurations at row ends"),
    "largest_step": Measure(1, "angle", 3, "least largest velocity-scaled step"),
    "motion_time": Measure(1, "time", 3, "time of the motion at the speed limits"),
    "singularities": Measure(1, None, 3, "singularities met by the planner"),
    "cycle_time": Measure(1, "time", 4, "duration of the planned trajectory"),
}
MeasureName = Literal[
    "length",
    "singularity_margin",
    "limit_margin",
    "lever",
    "compliance",
    "reconfigurations",
    "row_end_reconfigurations",
    "largest_step",
    "motion_time",
    "singularities",
    "cycle_time",
]
assert get_args(MeasureName) == tuple(MEASURES)
# With more, hardly any design beats another, and the hypervolume is expensive.
_MOST_OBJECTIVES = 3
_DIMENSIONS: tuple[Dimension, ...] = get_args(Dimension)
_PART = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


class DesignVariable(Part):
    """The range of a variable; ``extend`` is how far a bound may be moved where it holds the design back."""

    range: tuple[str, str]
    extend: tuple[str, str] | None = None

    @field_validator("range", "extend", mode="before")
    @classmethod
    def _pair(cls, value: object) -> object:
        if value is None:
            return None
        if not isinstance(value, (list, tuple)) or len(value) != 2:
            raise problem('must be a list of two quantities, lower and upper, such as ["300 mm", "600 mm"]')
        found = []
        for one in value:
            try:
                dimension = _dimension(one)
                found.append((dimension, quantity(one, dimension)))
            except ValueError as error:
                raise problem(str(error)) from None
        (first, low), (second, high) = found
        if first != second:
            raise problem(f"{value[0]!r} is {_article(first)} and {value[1]!r} {_article(second)}")
        if not low < high:
            raise problem(f"the bounds are reversed or equal: {value[0]} to {value[1]}")
        return value

    @field_validator("extend")
    @classmethod
    def _around(cls, value: tuple[str, str] | None, info: ValidationInfo) -> tuple[str, str] | None:
        inner = info.data.get("range")
        if value is None or inner is None:
            return value
        dimension = _dimension(inner[0])
        if _dimension(value[0]) != dimension:
            raise problem(f"must be {_article(dimension)} like range")
        (low, high), (least, most) = (_values(pair, dimension) for pair in (inner, value))
        if least > low or most < high:
            raise problem("must include range")
        return value

    @property
    def dimension(self) -> Dimension:
        """What the variable is."""
        return _dimension(self.range[0])

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound (SI)."""
        return _values(self.range, self.dimension)

    @property
    def hard_bounds(self) -> tuple[float, float]:
        """How far the bounds may be moved (SI)."""
        return _values(self.extend or self.range, self.dimension)


class Design(Part):
    """What may be chosen, and what a good choice is. That the whole surface is covered is always asked.

    ``limits`` holds further measures to a value: the most that is allowed, or the least where more is better.
    """

    variables: dict[str, DesignVariable] = Field(min_length=1)
    objectives: tuple[MeasureName, ...] = ("length", "singularity_margin")
    limits: dict[MeasureName, str | float] = Field(default_factory=dict)

    @field_validator("variables", mode="before")
    @classmethod
    def _quoted(cls, value: object) -> object:
        if isinstance(value, Mapping):
            for name, table in value.items():
                if isinstance(table, Mapping) and any(isinstance(inner, Mapping) for inner in table.values()):
                    raise problem(f'write the path in quotes, such as [design.variables."{name}.lengths.L1"]')
        return value

    @field_validator("objectives")
    @classmethod
    def _differ(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if not value:
            raise problem("must have at least 1 entry, not 0")
        if len(value) > _MOST_OBJECTIVES:
            raise problem(f"must have at most {_MOST_OBJECTIVES} entries, not {len(value)}; hold others by limits")
        repeated = sorted({name for name in value if value.count(name) > 1})
        if repeated:
            raise problem(f"objectives must differ; repeated: {', '.join(repeated)}")
        return value

    @field_validator("limits", mode="before")
    @classmethod
    def _usable(cls, value: object) -> object:
        if not isinstance(value, Mapping):
            return value
        for name, limit in value.items():
            measure = MEASURES.get(name)
            if measure is None:
                raise problem(f"{name!r} is not a measure{_did_you_mean(str(name), MEASURES)}")
            if measure.dimension is not None:
                try:
                    quantity(limit, measure.dimension)
                except ValueError as error:
                    raise problem(f"{name}: {error}") from None
            elif isinstance(limit, bool) or not isinstance(limit, (int, float)):
                raise problem(f"{name}: must be a number, not {limit!r}")
        return value

    def limit_values(self) -> dict[str, float]:
        """Return the limits in SI."""
        found = {}
        for name, limit in self.limits.items():
            dimension = MEASURES[name].dimension
            found[name] = float(limit) if dimension is None else quantity(limit, dimension)
        return found


# --- paths -------------------------------------------------------------------------------------------


def own_value(data: Mapping[str, Any], key: str) -> tuple[float, Dimension]:
    """Return the value of a quantity of a cell and what it is.

    Parameters
    ----------
    data : mapping
        :meth:`qparm.cell.Cell.to_dict`.
    key : str
        Its path, such as ``"arm.joints.d1.position[1]"``.

    Raises
    ------
    ValueError
        With one sentence, if there is no such quantity.
    """
    holder, last = _holder(data, key)
    value = holder[last]
    if isinstance(value, (list, tuple)):
        names = " or ".join(f"{key}[{k}]" for k in range(min(len(value), 3)))
        raise ValueError(f"has {len(value)} values; name one of them, such as {names}")
    if isinstance(value, Mapping):
        raise ValueError(f"is a table; name a quantity in it, such as {key}.{next(iter(value), 'key')}")
    try:
        dimension = _dimension(value)
        return quantity(value, dimension), dimension
    except ValueError:
        if isinstance(value, str) and value in data["arm"].get("lengths", {}):
            raise ValueError(f"is the name {value!r}; vary arm.lengths.{value}") from None
        raise ValueError(f"is {value!r}, which is not a quantity with a unit") from None


def dimension_of_key(data: Mapping[str, Any], key: str) -> Dimension:
    """Return what a quantity of a cell is."""
    return own_value(data, key)[1]


def changed(data: Mapping[str, Any], values: Mapping[str, float]) -> dict[str, Any]:
    """Return the data of a cell with other values (SI) of some quantities; the rest is shared."""
    import copy

    out = copy.deepcopy(dict(data))
    for key, value in values.items():
        _, dimension = own_value(data, key)
        holder, last = _holder(out, key)
        holder[last] = format_quantity(value, dimension)
    return out


def wrong_design(data: Mapping[str, Any], design: Design) -> list[tuple[str, str]]:
    """Return all that is wrong with the variables of a cell that is valid otherwise: key path and sentence."""
    wrong, meant = [], {}
    for key, variable in design.variables.items():
        where = f'design.variables."{key}"'
        try:
            own, dimension = own_value(data, key)
        except ValueError as error:
            wrong.append((where, str(error)))
            continue
        if variable.dimension != dimension:
            wrong.append((f"{where}.range", f"must be {_article(dimension)}: that is what {key} is"))
        if key.startswith("arm.lengths.") and own >= 0 > variable.hard_bounds[0]:
            where_ = "extend" if variable.bounds[0] >= 0 else "range"
            wrong.append((f"{where}.{where_}", f"{key} is the length of a link, which is not negative"))
        holder, last = _holder(data, key)
        first = meant.setdefault((id(holder), last), key)
        if first != key:
            wrong.append((where, f"is the same quantity as {first}"))
    return wrong


def _holder(data: Mapping[str, Any], key: str) -> tuple[Any, Any]:
    """Return the table or list that holds a quantity, and its key there."""
    parts = [int(index) if index else name for name, index in _PART.findall(key)]
    if not parts or "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts)[1:] != key:
        raise ValueError("is not a path in the cell; write it such as arm.lengths.L1 or workpiece.pose.position[1]")
    if parts[0] == "design":
        raise ValueError("is part of the design itself")
    here: Any = data
    for k, part in enumerate(parts):
        before = _joined(parts[:k])
        if isinstance(here, Mapping):
            if part not in here:
                raise ValueError(f"there is no {part!r} in {before or 'the cell'}{_did_you_mean(str(part), here)}")
        elif isinstance(here, (list, tuple)):
            part = _index(here, part, before)
        else:
            raise ValueError(f"{before} is a single value, there is nothing in it")
        if k == len(parts) - 1:
            return here, part
        here = here[part]
    raise AssertionError("a path has a last part")


def _index(entries: Sequence[Any], part: str | int, before: str) -> int:
    if isinstance(part, int):
        if part >= len(entries):
            raise ValueError(f"{before} has {len(entries)} entries, 0 to {len(entries) - 1}; there is no [{part}]")
        return part
    names = [entry.get("name") for entry in entries if isinstance(entry, Mapping)]
    if part not in names:
        known = f" (known: {', '.join(map(str, names))})" if names else ""
        raise ValueError(f"there is no {part!r} in {before}{known}; entries of a list are named by index, [0]")
    return names.index(part)


def _joined(parts: Sequence[str | int]) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")


# --- quantities of any kind --------------------------------------------------------------------------


def _dimension(value: object) -> Dimension:
    """Return what a quantity is by its unit."""
    for dimension in _DIMENSIONS:
        try:
            quantity(value, dimension)
        except ValueError:
            continue
        return dimension
    quantity(value, "length")  # raises with a sentence that shows a right spelling
    raise AssertionError("what is a length was found above")


def _values(pair: tuple[str, str], dimension: Dimension) -> tuple[float, float]:
    return quantity(pair[0], dimension), quantity(pair[1], dimension)


def _article(dimension: Dimension) -> str:
    return f"{'an' if dimension[0] in 'aeiou' else 'a'} {dimension}"


def _did_you_mean(name: str, known: Mapping[str, Any]) -> str:
    near = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else f" (known: {', '.join(map(str, known))})"
