"""The verdict on a motion: what was checked, how far it went, and what is wrong where."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Check", "Findings", "MotionReport", "Violation", "shown"]

# From each unit: (below this, scale, name), the last without a bound.
_LENGTH = ((1e-6, 1e9, "nm"), (1e-3, 1e6, "um"), (float("inf"), 1e3, "mm"))
_ANGLE = ((1e-3, 1e6, "urad"), (float("inf"), 57.29577951308232, "deg"))
# A length or an angle below this is none (m, rad).
_NOTHING = 1e-12
_PER = ("/s^3", "/s^2", "/s")


def shown(value: float, unit: str) -> str:
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
        return f"{value:.6g} {unit}".rstrip()
    # a velocity is never small enough for another unit: only lengths and angles change theirs
    if not per and abs(value) < _NOTHING:
        return f"0 {scales[-1][2]}"
    _, scale, name = scales[-1] if per else next(row for row in scales if abs(value) < row[0])
    return f"{value * scale:.{6 if per else 4}g} {name}{per}"


@dataclass(frozen=True)
class Violation:
    """One thing that is wrong, where it is first so, and its worst.

    Attributes
    ----------
    subject : str
        ``"joint 'theta3'"``, ``"tool"``, ``"time"``, ``"columns"``.
    what : str
        What is beyond its limit, such as ``"velocity"``.
    time : float
        Where it is first (s).
    amount, limit : float
        The worst, and what is allowed; in ``unit``.
    unit : str
        ``"m"``, ``"rad/s"``, ..., ``"share"``, ``"bool"``; empty for a number.
    count : int
        Samples, or places between them, at which it is so.
    """

    subject: str
    what: str
    time: float
    amount: float
    limit: float
    unit: str
    count: int = 1

    def sentence(self) -> str:
        """Return it in words."""
        more = f", worst of {self.count} places" if self.count > 1 else ""
        return (
            f"{self.time:.4f} s: {self.subject}: {self.what} {shown(self.amount, self.unit)},"
            f" allowed {shown(self.limit, self.unit)}{more}"
        )


@dataclass(frozen=True)
class Check:
    """One line of the table.

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


@dataclass(frozen=True)
class MotionReport:
    """What a trajectory file is worth, measured against a cell.

    Attributes
    ----------
    format : str
    samples : int
    duration : float
        s.
    period : float
        Between samples (s); NaN if they are the ends of polynomials, at times of their own.
    checks : tuple of Check
    violations : tuple of Violation
        Ordered by time.
    """

    format: str
    samples: int
    duration: float
    period: float
    checks: tuple[Check, ...]
    violations: tuple[Violation, ...]

    @property
    def kept(self) -> bool:
        """Whether every limit and tolerance holds."""
        return not self.violations

    def problems(self, most: int = 10) -> tuple[str, ...]:
        """Return a sentence for each of the first violations and one for how many follow; none if all is well."""
        sentences = [violation.sentence() for violation in self.violations[:most]]
        if len(self.violations) > most:
            sentences.append(f"and {len(self.violations) - most} more")
        return tuple(sentences)

    def text(self) -> str:
        """Return the table and the verdict."""
        how = "points of quintics" if self.period != self.period else f"a sample every {self.period * 1e3:.6g} ms"
        rows = [("checked", "worst", "allowed", "where")]
        rows += [(c.name, shown(c.worst, c.unit), shown(c.limit, c.unit), c.where) for c in self.checks]
        widths = [max(len(row[k]) for row in rows) for k in range(3)]
        lines = [f"{self.format}: {self.samples} samples, {self.duration:.6g} s, {how}", ""]
        for name, worst, limit, where in rows:
            lines.append(f"{name:<{widths[0]}}  {worst:>{widths[1]}}  {limit:>{widths[2]}}  {where}".rstrip())
        if self.kept:
            return "\n".join([*lines, "", "verdict: every limit and tolerance holds"])
        return "\n".join([*lines, "", "verdict: NOT kept", *(f"  - {sentence}" for sentence in self.problems())])


class Findings:
    """The lines of the table and what is wrong, as they are found."""

    def __init__(self) -> None:
        self.checks: list[Check] = []
        self.violations: list[Violation] = []

    def check(self, name: str, worst: float, limit: float, unit: str, where: str = "") -> None:
        """Add a line to the table."""
        self.checks.append(Check(name, float(worst), float(limit), unit, where))

    def wrong(
        self, subject: str, what: str, time: float, amount: float, limit: float, unit: str, count: int = 1
    ) -> None:
        """Add what is wrong."""
        self.violations.append(Violation(subject, what, float(time), float(amount), float(limit), unit, int(count)))
