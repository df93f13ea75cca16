"""The verdict: everything that speaks against executing a trajectory, in one place."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from qparm.verify.finding import Finding, grouped

if TYPE_CHECKING:
    from qparm.verify.motion_report import MotionReport

__all__ = ["Verdict"]


@dataclass(frozen=True)
class Verdict:
    """What speaks against a trajectory; nothing if it may be executed.

    Attributes
    ----------
    own : tuple of Finding
        What the file of the motion cannot show: motions off the surface for which no safe way was found, and files
        that do not belong together.
    motion : MotionReport or None
        What ``qparm verify`` says of the motion; None where the arm does not move at all.
    """

    own: tuple[Finding, ...]
    motion: MotionReport | None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All of them, those of the motion in the order of their times."""
        return (*self.own, *(self.motion.findings if self.motion is not None else ()))

    @property
    def executable(self) -> bool:
        """Whether nothing speaks against execution."""
        return not self.findings

    @cached_property
    def reasons(self) -> tuple[str, ...]:
        """A sentence for each kind of finding."""
        return grouped(self.findings)
