"""The verdict on a motion: what was checked, how far it went, and what is wrong where."""

from __future__ import annotations

from dataclasses import dataclass

from qparm.verify.finding import Check, Finding, shown

__all__ = ["OFF_PATH", "TURNED_OFF_PATH", "MotionReport"]

# What is said of a tool that is off its path, or turned off it.
OFF_PATH, TURNED_OFF_PATH = "off its path", "orientation error"


@dataclass(frozen=True)
class MotionReport:
    """Quality figures of a trajectory file, measured against a cell.

    Attributes
    ----------
    format : str
    samples : int
    duration : float
        s.
    period : float
        Between samples (s); NaN if they are points at times of their own.
    checks : tuple of Check
    findings : tuple of Finding
        Ordered by time.
    known : tuple of str
        How far the file tells what the cell asks for, where that is less: ``"points known to 0.64 mm"``, ``"feed not
        told"``.
    not_told : tuple of str
        What nobody can know from the file: ``"how near the points are passed (zone z0)"``.
    """

    format: str
    samples: int
    duration: float
    period: float
    checks: tuple[Check, ...]
    findings: tuple[Finding, ...]
    known: tuple[str, ...] = ()
    not_told: tuple[str, ...] = ()

    @property
    def kept(self) -> bool:
        """Whether every limit and tolerance holds, as far as the file tells."""
        return not self.findings

    @property
    def off_path(self) -> tuple[float, float]:
        """How far the tool is off its path on rows and transitions (m, rad); NaN where it follows none."""
        position, rotation = (
            max((one.worst for one in self.checks if one.name.startswith(f"tool {what} on ")), default=float("nan"))
            for what in (OFF_PATH, TURNED_OFF_PATH)
        )
        return position, rotation

    def problems(self, most: int = 10) -> tuple[str, ...]:
        """Return a sentence for each of the first findings and one for how many follow; none if all is well."""
        sentences = [finding.sentence() for finding in self.findings[:most]]
        if len(self.findings) > most:
            sentences.append(f"and {len(self.findings) - most} more")
        return tuple(sentences)

    def text(self) -> str:
        """Return the table and the verdict."""
        grid = self.period == self.period
        how = f"a sample every {self.period * 1e3:.6g} ms" if grid else "points at times of their own"
        rows = [("checked", "worst", "allowed", "where")]
        rows += [(c.name, shown(c.worst, c.unit), shown(c.limit, c.unit), c.where) for c in self.checks]
        widths = [max(len(row[k]) for row in rows) for k in range(3)]
        lines = [f"{self.format}: {self.samples} samples, {self.duration:.6g} s, {how}", ""]
        for name, worst, limit, where in rows:
            lines.append(f"{name:<{widths[0]}}  {worst:>{widths[1]}}  {limit:>{widths[2]}}  {where}".rstrip())
        return "\n".join([*lines, "", *self._verdict()])

    def _verdict(self) -> list[str]:
        """Return the lines of the verdict: no more than what the file tells."""
        if not self.kept:
            return ["verdict: NOT kept", *(f"  - {sentence}" for sentence in self.problems())]
        if not self.known and not self.not_told:
            return ["verdict: every limit and tolerance holds"]
        known = f": {', '.join(self.known)}" if self.known else ""
        return [f"verdict: holds as far as the file tells{known}", *(f"  - not told: {what}" for what in self.not_told)]
