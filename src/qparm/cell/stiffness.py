"""Stiffness: what of an arm deflects under a force; the table ``[arm.stiffness]``, for an arm of either kind.

Values for all joints of a kind, and for single ones by name, which come first. Nothing is assumed: what is not given is
not known, and only the links are rigid unless it is said how they bend.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from pydantic import Field, field_validator

from qparm.cell.part import Part
from qparm.cell.quantities import BendingStiffness, LinearStiffness, TorsionalStiffness, positive, quantity
from qparm.units import Dimension

__all__ = ["Stiffness", "missing_stiffness", "wrong_stiffness"]

_DIMENSION_OF_KIND: dict[str, Dimension] = {"prismatic": "linear stiffness", "revolute": "torsional stiffness"}


class _Joint(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def type(self) -> Any: ...


class Stiffness(Part):
    """Stiffness of joints, and bending stiffness EI of every link (rigid if it is left out)."""

    revolute: TorsionalStiffness | None = None
    prismatic: LinearStiffness | None = None
    joints: dict[str, str] = Field(default_factory=dict)
    links: BendingStiffness | None = None

    @field_validator("revolute", "prismatic", "links")
    @classmethod
    def _positive(cls, value: float | None) -> float | None:
        return value if value is None else positive(value)

    def of(self, joint: _Joint) -> float | None:
        """Return the stiffness of a joint (SI), None if it is not given."""
        own = self.joints.get(joint.name)
        return getattr(self, joint.type) if own is None else quantity(own, _DIMENSION_OF_KIND[joint.type])


def wrong_stiffness(stiffness: Stiffness | None, joints: Sequence[_Joint]) -> list[tuple[str, str]]:
    """Return all that is wrong with the stiffnesses of single joints: key path and sentence."""
    wrong = []
    kinds = {joint.name: joint.type for joint in joints}
    for name, value in ({} if stiffness is None else stiffness.joints).items():
        where = f"arm.stiffness.joints.{name}"
        if name not in kinds:
            wrong.append((where, f"the arm has no joint {name!r}; its joints are {', '.join(kinds)}"))
            continue
        try:
            if not quantity(value, _DIMENSION_OF_KIND[kinds[name]]) > 0:
                wrong.append((where, f"must be greater than zero, not {value}"))
        except ValueError as error:
            wrong.append((where, str(error)))
    return wrong


def missing_stiffness(stiffness: Stiffness | None, joints: Sequence[_Joint]) -> str:
    """Return which joints have no stiffness and where it belongs, as a sentence; empty if all have."""
    known = Stiffness() if stiffness is None else stiffness
    words = []
    for kind, example in (("prismatic", "20 kN/mm"), ("revolute", "50 kN m/rad")):
        names = [joint.name for joint in joints if joint.type == kind and known.of(joint) is None]
        if names:
            words.append(
                f'arm.stiffness.{kind} = "{example}" (or arm.stiffness.joints.{names[0]}) for {", ".join(names)}'
            )
    return f"the stiffness of every joint must be known; give {' and '.join(words)}" if words else ""
