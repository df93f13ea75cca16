"""The common part of all readers: the checks that a motion must pass, and what the digits of a text file leave open."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.verify.motion import MotionTable, unusable_numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from qparm.cell import Cell

__all__ = ["converted_rounding", "motion_table", "time_rounding", "value_rounding"]

# A file with fewer digits gets no more slack than this (m, rad; s): "0.5" may mean a half.
_MOST_ROUNDING, _MOST_TIME_ROUNDING = 1e-5, 1e-6
# Times on a grid are what the grid says, to this (s).
_ON_GRID = 1e-9
# Rows of a table that are looked at for their digits.
_LOOKED_AT = 2000
# Decimals that tables in SI are written with.
_DECIMALS = range(5, 14)
# A motion of more than the first (s), and of more than so many times what the path takes at the feed, has samples no
# farther apart, in the mean, than this (s).
_SPARSE, _SLOWEST, _SPARSEST = 500.0, 10.0, 2.0
# A step by whole turns is a wrapped angle where what is left of it takes no more than this many times the velocity
# limit, and the step itself more than that many times.
_WRAP_SLACK, _WRAP_SPEED = 1.5, 3.0


def motion_table(
    file: Path,
    cell: Cell,
    *,
    format: str,
    joints: Sequence[str],
    t: NDArray[np.float64],
    derivatives: Sequence[NDArray[np.float64] | None],
    position_rounding: Callable[[], NDArray[np.float64]],
    time_rounding: float,
    place: Callable[[int], str],
    row: NDArray[np.int64] | None = None,
    segment: NDArray[np.str_] | None = None,
    executable: bool = True,
    stops: NDArray[np.int64] | None = None,
    not_told: tuple[str, ...] = (),
) -> MotionTable:
    """Return the table of a file after checking it.

    Parameters
    ----------
    file : Path
    cell : Cell
        Whose joints are to be in it, all and once, in any order.
    format : str
    joints : sequence of str
        In the order of the columns.
    t : (T,) ndarray
        s.
    derivatives : sequence of (T, n) ndarray or None
        Position, velocity, acceleration, jerk; those at the end may be left out.
    position_rounding : callable
        Returns (n,) values (m, rad); called when all values are known to be finite.
    time_rounding : float
    place : callable
        Where sample k is in the file, such as ``"line 7"``.
    row, segment : (T,) ndarray, optional
    executable : bool
    stops : (S,) ndarray of int, optional
    not_told : tuple of str

    Raises
    ------
    InvalidInput
        If the joints are not those of the cell, there is no sample, a value is not finite or larger than any motion's,
        times do not ascend, or angles are wrapped.
    """
    _require_joints(file, joints, [joint.name for joint in cell.arm.joints])
    if not len(t):
        raise InvalidInput(f"{file.name} holds no sample; it may be cut short")
    wrong = unusable_numbers(t, derivatives, joints, place)
    if wrong:
        raise InvalidInput(f"{file.name} {wrong}")
    _require_dense(file, cell, t, place)
    _require_unwrapped(file, cell, joints, t, derivatives[0], place)
    q, velocity, acceleration, jerk = (
        None if values is None else np.ascontiguousarray(values, dtype=np.float64)
        for values in (*derivatives, *(None,) * (4 - len(derivatives)))
    )
    assert q is not None
    return MotionTable(
        format=format,
        joints=tuple(joints),
        t=np.ascontiguousarray(t, dtype=np.float64),
        q=q,
        velocity=velocity,
        acceleration=acceleration,
        jerk=jerk,
        position_rounding=position_rounding(),
        time_rounding=time_rounding,
        row=row,
        segment=segment,
        executable=executable,
        stops=stops,
        not_told=not_told,
    )


def _require_joints(file: Path, joints: Sequence[str], expected: Sequence[str]) -> None:
    twice = [name for name, count in Counter(joints).items() if count > 1]
    if twice:
        raise InvalidInput(f"{file.name} has joint {twice[0]!r} more than once")
    unknown = [name for name in joints if name not in expected]
    missing = [name for name in expected if name not in joints]
    if unknown:
        near = get_close_matches(unknown[0], missing or expected, n=1)
        hint = f"; {near[0]!r} may be meant" if near else ""
        raise InvalidInput(
            f"{file.name} has a joint {unknown[0]!r} that the cell has not{hint}; its joints are {', '.join(expected)}"
        )
    if missing:
        raise InvalidInput(f"{file.name} lacks {_joints(missing)} of the cell; it has {', '.join(joints) or 'none'}")


def _require_dense(file: Path, cell: Cell, t: NDArray[np.float64], place: Callable[[int], str]) -> None:
    """Refuse a motion that takes much longer than the cell's path with few samples: all of it would be looked at."""
    path = cell.tool_path()
    way = sum(row.length for row in path.rows) + sum(transition.length for transition in path.transitions)
    longest = max(_SPARSE, _SPARSEST * len(t), _SLOWEST * way / cell.process.feed)
    if t[-1] - t[0] <= longest:
        return
    step = np.diff(t)
    at = int(step.argmax())
    raise InvalidInput(
        f"{file.name} {place(at + 1)}: {len(t)} samples over {t[-1] - t[0]:.6g} s are too few to tell the motion; up to"
        f" {step[at]:.6g} s lie between two of them, and the cell's path takes {way / cell.process.feed:.3g} s"
    )


def _require_unwrapped(
    file: Path, cell: Cell, joints: Sequence[str], t: NDArray[np.float64], q: NDArray[np.float64] | None,
    place: Callable[[int], str],
) -> None:  # fmt: skip
    """Refuse angles that jump by a whole turn from sample to sample: the file brings them back into one turn."""
    known = {joint.name: joint for joint in cell.arm.joints}
    assert q is not None
    for k, name in enumerate(joints):
        if known[name].type != "revolute":
            continue
        step = np.diff(q[:, k])
        whole = np.round(step / (2 * np.pi))
        # what is left of a step beyond the turn is a motion that the joint can do, and the step itself is none
        left = np.abs(step - 2 * np.pi * whole)
        possible = known[name].velocity * np.diff(t)
        at = np.flatnonzero((whole != 0) & (left <= _WRAP_SLACK * possible) & (np.abs(step) > _WRAP_SPEED * possible))
        if len(at):
            raise InvalidInput(
                f"{file.name} {place(int(at[0]) + 1)}: the angle of joint {name!r} jumps by"
                f" {np.degrees(step[at[0]]):.6g} deg, as where angles are wrapped into one turn"
                f" ({len(at)} times in all); unwrap them, such as with numpy.unwrap"
            )


def _joints(names: Sequence[str]) -> str:
    return f"joint {names[0]!r}" if len(names) == 1 else "joints " + ", ".join(repr(name) for name in names)


def value_rounding(values: NDArray[np.float64], scale: float | NDArray[np.float64] = 1.0) -> NDArray[np.float64]:
    """Return half a unit of the last place that a table of text gives its values, one for each column, (n,).

    Found from the values themselves: the longest of them shows how many digits the file gives, as significant
    digits and as decimals; whichever leaves more open counts, but never more than 1e-5 (m, rad).

    Parameters
    ----------
    values : (T, n) ndarray
        As the file writes them, in its units.
    scale : float or (n,) ndarray
        What makes SI of them; the answer is in SI.
    """
    looked_at = values[:: max(1, len(values) // _LOOKED_AT)]
    significant, decimals = 1, -400
    for value in looked_at.ravel().tolist():
        digits, exponent = _decimal(value)
        significant = max(significant, digits)
        decimals = max(decimals, digits - 1 - exponent)
    largest = np.abs(values).max(axis=0, initial=0.0)
    exponents = np.floor(np.log10(np.where(largest > 0, largest, 1.0)))
    last = np.maximum(10.0 ** (exponents - significant + 1), 10.0 ** min(-decimals, 0))
    return np.minimum(0.5 * last * scale, _MOST_ROUNDING)


def converted_rounding(values: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return half a unit of the last place of values (T, n) that may have been converted from SI, (n,) in SI.

    A table in radians that someone turned into degrees has all digits of a float, and no more truth in them than
    before: back in radians its values have few decimals again, and these count.
    """
    own = value_rounding(values, scale)
    turned = np.flatnonzero((scale != 1.0) & values.any(axis=0))
    if not len(turned):
        return own
    q = values[:, turned] * scale[turned]
    # two conversions round twice, each by half a unit of the float's last place
    slack = 4.0 * np.spacing(np.abs(q))
    for decimals in _DECIMALS:
        if (np.abs(q - np.round(q, decimals)) <= slack).all():
            plain = np.flatnonzero(scale == 1.0)
            if len(plain):  # by their own digits, which the others' would hide
                own[plain] = value_rounding(values[:, plain])
            own[turned] = np.maximum(own[turned], min(0.5 * 10.0**-decimals, _MOST_ROUNDING))
            break
    return own


def time_rounding(t: NDArray[np.float64]) -> float:
    """Return half a unit of the last place of the times of a table of text; 0 if they lie on a grid (s).

    The last time, the motion's end, may be off the grid; then its digits count.
    """
    if len(t) < 3 or not np.isfinite(t).all():
        return 0.0
    period = (t[-2] - t[0]) / (len(t) - 2)
    on_grid = np.abs(t - t[0] - period * np.arange(len(t))) <= _ON_GRID
    if on_grid.all():
        return 0.0
    which = t[-1:] if on_grid[:-1].all() else t[:: max(1, len(t) // _LOOKED_AT)]
    decimals = max(digits - 1 - exponent for digits, exponent in map(_decimal, which.tolist()))
    return float(min(0.5 * 10.0**-decimals, _MOST_TIME_ROUNDING))


def _decimal(value: float) -> tuple[int, int]:
    """Return the number of significant digits of a value's shortest text and the power of ten of the first."""
    if value == 0:
        return 1, 0
    mantissa, _, exponent = f"{value!r}".partition("e")
    whole, _, fraction = mantissa.lstrip("-").partition(".")
    digits = (whole + fraction).lstrip("0")
    first = (len(whole.lstrip("0")) or len(digits) - len(fraction)) - 1
    return max(len(digits.rstrip("0")), 1), first + int(exponent or 0)
