"""Common parts of the controller programs: which joint is which axis, units, rounding, blocks from rest to rest."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from qparm.export.sampled import SampledTrajectory

__all__ = ["Axes", "Block", "blocks", "controller_axes", "program_name", "remark"]

# Digits after the point: a controller keeps numbers in single precision, seven digits.
DEGREE_DIGITS, MILLIMETRE_DIGITS, SECOND_DIGITS = 5, 4, 6
_ARM_AXES = 6
# Characters of a comment.
_REMARK = 200


@dataclass(frozen=True)
class Axes:
    """Which joints are the axes of a controller.

    Attributes
    ----------
    arm : tuple of int
        The joints that are axes 1 to 6.
    external : int or None
        The joint that is the external axis.
    """

    arm: tuple[int, ...]
    external: int | None

    def degrees(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the six axes, (T, 6), of positions (T, n)."""
        return _without_sign(np.degrees(q[:, self.arm]), DEGREE_DIGITS)

    def millimetres(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the external axis, (T,), of positions (T, n)."""
        assert self.external is not None
        return _without_sign(q[:, self.external] * 1e3, MILLIMETRE_DIGITS)


@dataclass(frozen=True)
class Block:
    """Samples from one rest to the next.

    Attributes
    ----------
    first, last : int
    what : str
        The segments in it, such as ``"row 3"``.
    """

    first: int
    last: int
    what: str


def controller_axes(
    joint_names: Sequence[str], units: Sequence[str], *, arm: Sequence[str], external: str, language: str
) -> Axes:
    """Return which joint is which axis: revolute joints in their order, and a prismatic joint as the external axis.

    Parameters
    ----------
    joint_names, units : sequence of str
    arm : sequence of str
        What the controller calls its six axes.
    external : str
        ... and its external one.
    language : str

    Raises
    ------
    InvalidInput
        If there are not six revolute joints and at most one prismatic; with the joints that do not fit.
    """
    turning = [k for k, unit in enumerate(units) if unit == "rad"]
    sliding = [k for k, unit in enumerate(units) if unit == "m"]
    if len(turning) == _ARM_AXES and len(sliding) <= 1:
        return Axes(tuple(turning), sliding[0] if sliding else None)
    left = [joint_names[k] for k in sorted((*turning[_ARM_AXES:], *sliding[1:]))]
    axes = dict(zip(arm, (joint_names[k] for k in turning), strict=False))
    if sliding:
        axes[external] = joint_names[sliding[0]]
    taken = ", ".join(f"{axis} {name}" for axis, name in axes.items())
    wrong = [f"no place for {', '.join(left)}"] if left else []
    empty = [axis for axis in arm if axis not in axes]
    wrong += [f"no joint for {', '.join(empty)}"] if empty else []
    raise InvalidInput(
        f"{language} moves six revolute joints, {arm[0]} to {arm[-1]}, and one external prismatic joint, {external};"
        f" this arm has {len(turning)} revolute and {len(sliding)} prismatic: {taken or 'none fit'};"
        f" {' and '.join(wrong)}. Formats that take any arm: json, yaml, mcap, rosbag2, csv, npz, stream"
    )


def program_name(stem: str, *, reserved: frozenset[str], language: str) -> str:
    """Return a file's name without its ending as the name of a program, or raise InvalidInput if it cannot be one."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,23}", stem) or stem.upper() in reserved:
        raise InvalidInput(
            f"the file's name is the program's, and {stem!r} cannot be one in {language}: a letter, then letters,"
            " digits and underscores, 24 in all, no word of the language"
        )
    return stem


def remark(text: str) -> str:
    """Return a text that can stand in a comment: printable ASCII on one line, whatever names it holds."""
    plain = "".join(c if c.isascii() and c.isprintable() else "?" for c in text)
    return plain if len(plain) <= _REMARK else plain[: _REMARK - 3] + "..."


def _without_sign(values: NDArray[np.float64], digits: int) -> NDArray[np.float64]:
    """Return values without the sign of those that round to zero."""
    return np.where(np.abs(values) < 0.5 * 10.0**-digits, 0.0, values)


def blocks(sampled: SampledTrajectory) -> list[Block]:
    """Return the runs of samples that are moved through without a stop."""
    segments = sampled.trajectory.segments
    at_rest = sampled.rests
    at_rest[[0, -1]] = True
    ends = np.flatnonzero(at_rest).tolist()
    found = []
    for first, last in pairwise(ends):
        # in the middle of the steps: at its ends, rounded to nanoseconds, a segment may be its neighbour's
        middle = 0.5 * (sampled.t[first:last] + sampled.t[first + 1 : last + 1])
        names = [segments[k].name for k in dict.fromkeys(sampled.trajectory.segment_at(middle).tolist())]
        found.append(Block(first, last, ", ".join(names)))
    return found
