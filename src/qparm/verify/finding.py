"""Findings: the one form in which anything that speaks against executing a trajectory is said.

Each is judged once, from what is handed over and with the tolerances of the cell. ``qparm plan``, ``qparm verify`` and
the library print the same findings, so that they cannot disagree.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

__all__ = ["AT_LIMIT", "LIMIT_SLACK", "Check", "Finding", "Findings", "grouped", "shown"]

# Shares of a limit up to 1 + this count as kept: the digits of a text file.
LIMIT_SLACK = 1e-6
# A joint no farther beyond a position limit than this is at it (m, rad).
AT_LIMIT = 1e-9

# From each unit: (below this, scale, name), the last without a bound.
_LENGTH = ((1e-6, 1e9, "nm"), (1e-3, 1e6, "um"), (float("inf"), 1e3, "mm"))
_ANGLE = ((1e-3, 1e6, "urad"), (float("inf"), 57.29577951308232, "deg"))
# A length or an angle below this is none (m, rad).
_NOTHING = 1e-12
_PER = ("/s^3", "/s^2", "/s")
# Values are printed with so many digits, or as many more as it takes to tell an amount from its limit.
_DIGITS, _MOST_DIGITS = 4, 12


def shown(value: float, unit: str, *, digits: int = _DIGITS) -> str:
    """Return a value in words: lengths in mm and below, angles in deg and below, shares in per cent."""
    if value != value:
        return "-"
    if unit == "bool":
        return "true" if value else "false"
    if unit == "share":
        return f"{value:.4%}" if abs(value - 1) < 0.01 else f"{value:.4g}" if value > 10 else f"{value:.2%}"
    per = next((end for end in _PER if unit.endswith(end)), "")
    scales = {"m": _LENGTH, "rad": _ANGLE}.get(unit.removesuffix(per))
    if scales is None:
        return f"{value:.{digits + 2}g} {unit}".rstrip()
    # a velocity is never small enough for another unit: only lengths and angles change theirs
    if not per and abs(value) < _NOTHING:
        return f"0 {scales[-1][2]}"
    _, scale, name = scales[-1] if per else next(row for row in scales if abs(value) < row[0])
    return f"{value * scale:.{digits + 2 if per else digits}g} {name}{per}"


@dataclass(frozen=True)
class Finding:
    """One thing that speaks against executing a trajectory: what, where it is first so, and its worst.

    Attributes
    ----------
    code : str
        Its kind, the same wherever it is found: ``"file"``, ``"files-differ"``, ``"time-grid"``, ``"position"``,
        ``"velocity"``, ``"acceleration"``, ``"jerk"``, ``"columns"``, ``"ends"``, ``"point"``, ``"path"``, ``"feed"``,
        ``"clearance"``, ``"row"``, ``"row-not-worked"`` or ``"motion"``.
    subject : str
        ``"joint 'theta3'"``, ``"tool"``, ``"point 12 of row 1"``, ``"file"``, ...
    what : str
        What is beyond its limit, such as ``"velocity in the file"``.
    place : str
        Where on the path, such as ``"on row 3"``; empty where the time says enough.
    time : float
        Where it is first (s); NaN where it has no time.
    amount, limit : float
        The worst, and what is allowed, in ``unit``; NaN where there is nothing to measure.
    unit : str
        ``"m"``, ``"rad/s"``, ..., ``"share"``, ``"bool"``; empty for a number.
    count : int
        Samples, or places between them, at which it is so.
    """

    code: str
    subject: str
    what: str
    place: str = ""
    time: float = float("nan")
    amount: float = float("nan")
    limit: float = float("nan")
    unit: str = ""
    count: int = 1

    def sentence(self) -> str:
        """Return it in words; an amount is told from its limit, however near the two are."""
        when = f"{self.time:.4f} s: " if self.time == self.time else ""
        what = f"{self.subject}: {self.what}" + (f" {self.place}" if self.place else "")
        if self.amount != self.amount:
            return when + what
        digits = _DIGITS
        while True:
            amount, limit = (shown(value, self.unit, digits=digits) for value in (self.amount, self.limit))
            if amount != limit or digits >= _MOST_DIGITS:
                break
            digits += 2
        more = f", worst of {self.count} places" if self.count > 1 else ""
        return f"{when}{what} {amount}, allowed {limit}{more}"


@dataclass(frozen=True)
class Check:
    """One line of the table of what was checked.

    Attributes
    ----------
    name : str
    worst, limit : float
        In ``unit``; NaN where there was nothing to check.
    unit : str
    where : str
        Joint, time, row of the worst.
    """

    name: str
    worst: float
    limit: float
    unit: str
    where: str = ""


class Findings:
    """What is checked, what is found and how far the file tells, as it is found."""

    def __init__(self) -> None:
        self.known: list[str] = []
        self.checks: list[Check] = []
        self.found: list[Finding] = []

    def check(self, name: str, worst: float, limit: float, unit: str, where: str = "") -> None:
        """Add a line to the table."""
        self.checks.append(Check(name, float(worst), float(limit), unit, where))

    def wrong(
        self, code: str, subject: str, what: str, time: float, amount: float, limit: float, unit: str, count: int = 1,
        *, place: str = "",
    ) -> None:  # fmt: skip
        """Add a finding; its parameters are the attributes of :class:`Finding`."""
        self.found.append(
            Finding(code, subject, what, place, float(time), float(amount), float(limit), unit, int(count))
        )


def grouped(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return a sentence for each kind of finding: the first of its kind, and how many more there are."""
    kinds: dict[tuple[str, str], list[Finding]] = {}
    for one in findings:
        # joints are told apart, points and rows are counted
        kinds.setdefault((one.code, one.subject if one.subject.startswith("joint") else ""), []).append(one)
    return tuple(_of_kind(code, found) for (code, _), found in kinds.items())


def _of_kind(code: str, found: Sequence[Finding]) -> str:
    first = found[0].sentence()
    if code == "point":
        points = "1 point is" if len(found) == 1 else f"{len(found)} points are"
        return f"{points} not reached: {first}" + (f"; and {len(found) - 1} more" if len(found) > 1 else "")
    return first + (f"; and {len(found) - 1} more of this kind" if len(found) > 1 else "")
