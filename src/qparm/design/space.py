"""The design space of a cell: its variables, what the cell is at a design, and the problem that engines search."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.cell import Cell
from qparm.cell.design import MEASURES, Design, own_value
from qparm.design.problem import Objective, Problem, Variable
from qparm.errors import CellError, InvalidInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain
    from qparm.units import Dimension

__all__ = ["DesignSpace", "link_length", "shown"]

# How far lengths may be from an affine function of the variables to count as one (m).
_AFFINE = 1e-12
_SHOWN: dict[str | None, tuple[float, str]] = {
    "length": (1e3, "mm"),
    "angle": (180 / np.pi, "deg"),
    "time": (1.0, "s"),
    "linear velocity": (1e3, "mm/s"),
    "angular velocity": (180 / np.pi, "deg/s"),
    "linear stiffness": (1e-6, "kN/mm"),
    "torsional stiffness": (1e-3, "kN m/rad"),
    "bending stiffness": (1e-3, "kN m^2"),
    "compliance": (1e6, "um/N"),
    None: (1.0, ""),
}


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """A cell and what of it may be chosen.

    Attributes
    ----------
    cell : Cell
        As it stands; its ``[design]`` table is not used.
    design : Design
    """

    cell: Cell
    design: Design

    @classmethod
    def of(
        cls, cell: Cell | Mapping[str, Any] | str | Path, *, ranges: Mapping[str, Sequence[str]] | None = None
    ) -> DesignSpace:
        """Return the space of a cell.

        Parameters
        ----------
        cell : Cell, mapping, str or Path
            What :meth:`Cell.load` takes.
        ranges : mapping of str to (str, str), optional
            Other ranges, or further variables: ``{"arm.lengths.L1": ("480 mm", "600 mm")}``.

        Raises
        ------
        CellError
            If the cell is not valid.
        InvalidInput
            If nothing may be chosen.
        """
        loaded = Cell.load(cell)
        if ranges:
            data = loaded.to_dict()
            table = data.setdefault("design", {})
            for key, pair in ranges.items():
                # a range that is given anew is meant: the bounds of the file do not extend it
                table.setdefault("variables", {})[key] = {"range": list(pair)}
            loaded = Cell.load(data)
        if loaded.design is None:
            raise InvalidInput(
                "the cell has no [design] table: nothing in it may be chosen; add one, or give ranges, such as"
                ' --vary "arm.lengths.L1=300 mm:600 mm"'
            )
        return cls(loaded, loaded.design)

    @cached_property
    def data(self) -> dict[str, Any]:
        """The cell as it stands, as a dictionary without ``[design]``."""
        return {key: table for key, table in self.cell.to_dict().items() if key != "design"}

    @property
    def keys(self) -> tuple[str, ...]:
        """Paths of the variables."""
        return tuple(self.design.variables)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables: of a link's length and of a joint without the tables they are in, else the path."""
        short = [key.removeprefix("arm.lengths.").removeprefix("arm.joints.") for key in self.keys]
        return tuple(name if short.count(name) == 1 else key for name, key in zip(short, self.keys, strict=True))

    @cached_property
    def unknown(self) -> tuple[str, ...]:
        """Measures that the cell has not what it takes for."""
        return () if self.cell.elasticity() is not None else ("compliance",)

    @cached_property
    def dimensions(self) -> tuple[Dimension, ...]:
        """What the variables are."""
        return tuple(variable.dimension for variable in self.design.variables.values())

    @cached_property
    def own(self) -> NDArray[np.float64]:
        """The cell's own design, (d,)."""
        return np.array([own_value(self.data, key)[0] for key in self.keys])

    @cached_property
    def variables(self) -> tuple[Variable, ...]:
        """The variables as engines know them."""
        found = []
        for key, variable in self.design.variables.items():
            (low, high), (least, most) = variable.bounds, variable.hard_bounds
            found.append(Variable(key, low, high, least, most))
        return tuple(found)

    def problem(self, objectives: Sequence[str]) -> Problem:
        """Return the problem of some objectives by name; what is better when larger is negated."""
        exact: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]] | None] = {"length": self._lengths}
        return Problem(
            self.variables,
            tuple(Objective(name, exact.get(name)) for name in objectives),
        )

    def cell_at(self, x: Sequence[float] | NDArray[np.float64]) -> Cell:
        """Return the cell at a design (d,), without ``[design]``.

        Raises
        ------
        CellError
            If the cell is not valid there.
        """
        values = dict(zip(self.keys, (float(value) for value in x), strict=True))
        return self.cell.with_values(values)

    def shown(self, x: Sequence[float] | NDArray[np.float64]) -> str:
        """Return a design in words: ``L1 480.0 mm, L3 418.0 mm``."""
        return ", ".join(
            f"{name} {shown(float(value), dimension)}"
            for name, value, dimension in zip(self.names, x, self.dimensions, strict=True)
        )

    @cached_property
    def _lengths(self) -> Callable[[NDArray[np.float64]], NDArray[np.float64]] | None:
        """Total length as an affine function of the variables, or None where it is not one."""
        lower = np.array([variable.hard_lower for variable in self.variables])
        upper = np.array([variable.hard_upper for variable in self.variables])
        try:
            base = self._length_at(lower)
            slope = np.array(
                [
                    (self._length_at(np.where(np.arange(len(lower)) == k, upper, lower)) - base) / (upper[k] - lower[k])
                    for k in range(len(lower))
                ]
            )
            rng = np.random.default_rng(0)
            tests = [upper, *(lower + rng.random((3, len(lower))) * (upper - lower))]
            if any(abs(self._length_at(x) - (base + slope @ (x - lower))) > _AFFINE for x in tests):
                return None
        except CellError:
            return None
        return lambda X: base + (X - lower) @ slope

    def _length_at(self, x: NDArray[np.float64]) -> float:
        return link_length(self.cell_at(x).chain())


def link_length(chain: SerialChain) -> float:
    """Return the total length of the links (m): the distances between neighbouring joints at zero, and to the tool.

    The seed's first objective: L1 + L2 + L3 + L4 for its arm.
    """
    origins = np.concatenate([chain.frames(np.zeros(chain.n))[1:, :3, 3]])
    return float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())


def shown(value: float, dimension: Dimension | None, *, digits: int = 5) -> str:
    """Return a value (SI) in the unit in which people read it."""
    factor, unit = _SHOWN.get(dimension, (1.0, "SI"))
    return f"{value * factor:.{digits}g} {unit}".rstrip()


def unit_of(dimension: Dimension | None) -> tuple[float, str]:
    """Return factor and name of the unit in which people read a dimension."""
    return _SHOWN.get(dimension, (1.0, "SI"))


def sense(name: str) -> int:
    """Return 1 where a measure is the better the smaller, else -1."""
    return MEASURES[name].sense
