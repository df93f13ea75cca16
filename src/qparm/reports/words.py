"""Figures in the words of reports."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from qparm.path import ToolPath
    from qparm.reach import Reach

__all__ = [
    "corner_lines",
    "counted",
    "many",
    "micrometres",
    "microradians",
    "reach_words",
    "shown",
    "spans",
    "speed_words",
    "time_words",
]


def shown(value: float, unit: str) -> str:
    """Return a joint's value (m, rad) in millimetres or degrees."""
    return f"{np.degrees(value):.3g} deg" if unit == "rad" else f"{value * 1e3:.3g} mm"


def spans(indices: list[int]) -> str:
    """Return ascending indices as ``3-7, 12``."""
    runs: list[list[int]] = []
    for index in indices:
        if runs and index == runs[-1][1] + 1:
            runs[-1][1] = index
        else:
            runs.append([index, index])
    return ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in runs)


def counted(counter: Counter[str], *, plain_single: bool = False) -> str:
    """Return how often each word was counted; a single one without its number if ``plain_single``."""
    if plain_single and len(counter) == 1:
        return next(iter(counter))
    return ", ".join(f"{count} {word}" for word, count in counter.most_common())


def reach_words(verdicts: Iterable[Reach | None]) -> str:
    """Return why points are not reached, those of one reason together; None where the arm could, but misses it."""
    groups: dict[object, list[Reach]] = {}
    missed = 0
    for one in verdicts:
        if one is None:
            missed += 1
        else:
            groups.setdefault((one.reason, one.relaxed), []).append(one)
    words: Counter[str] = Counter({"beyond tolerance": missed} if missed else {})
    for group in groups.values():
        least, most = (f"{pick(one.excess for one in group) * 1e3:.1f}" for pick in (min, max))
        words[group[0].sentence(least if least == most else f"{least} to {most}")] += len(group)
    return counted(words, plain_single=True)


def speed_words(value: float) -> str:
    """Return a speed (m/s) in mm/s, a dash if there is none."""
    return "-" if np.isnan(value) else f"{value * 1e3:.3g} mm/s"


def many(count: int, what: str) -> str:
    """Return a number of things."""
    return f"{count} {what}" + ("" if count == 1 else "s")


def micrometres(value: float) -> str:
    """Return a distance (m) in micrometres, from a millimetre on in those, a dash if there is none."""
    if np.isnan(value):
        return "-"
    return f"{value * 1e3:.3g} mm" if value >= 0.9995e-3 else f"{value * 1e6:.3g} um"


def microradians(value: float) -> str:
    """Return an angle (rad) in microradians, from a thousand of them on in degrees, a dash if there is none."""
    if np.isnan(value):
        return "-"
    return f"{np.degrees(value):.3g} deg" if value >= 0.9995e-3 else f"{value * 1e6:.3g} urad"


def time_words(seconds: float) -> str:
    """Return a time in milliseconds, from a second on in those, from two minutes on in minutes."""
    if seconds >= 119.5:
        return f"{seconds / 60:.3g} min"
    return f"{seconds:.3g} s" if seconds >= 0.9995 else f"{seconds * 1e3:.3g} ms"


def corner_lines(tool_path: ToolPath, *, width: int = 16, most: int = 10) -> list[str]:
    """Return where the tool rests at a corner in what was given as one row; nothing if nowhere."""
    corners = tool_path.corners
    if not corners:
        return []
    lines = [f"{'corners':<{width}}{len(corners)} in rows of the pose list: the tool rests there, and a new row begins"]
    for corner in corners[:most]:
        place = ", ".join(f"{1e3 * x:.6g}" for x in corner.pose[:3, 3])
        lines.append(f"  rows {corner.row - 1} and {corner.row} meet at line {corner.line} ({place} mm): {corner.what}")
    return lines + ([f"  and {len(corners) - most} more"] if len(corners) > most else [])
