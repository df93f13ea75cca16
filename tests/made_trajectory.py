"""A made-up trajectory with every kind of segment, and cells whose arms have its joints."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import PPoly

from conftest import cell_data
from qparm.path import SegmentKind, TimedSegment, Trajectory
from qparm.path.quintic import quintic_coefficients

__all__ = ["RAIL_AND_SEVEN", "RAIL_AND_SIX", "cell_of", "made_trajectory", "units_of"]

RAIL_AND_SEVEN = ("d1", *(f"theta{k}" for k in range(2, 9)))
RAIL_AND_SIX = RAIL_AND_SEVEN[:-1]
# Kind, row, knots inside, seconds: no end is on a tick of any period.
_SEGMENTS = (
    (SegmentKind.APPROACH, -1, 0, 0.4123456789),
    (SegmentKind.ROW, 0, 3, 0.7010000011),
    (SegmentKind.TRANSITION, 0, 1, 0.1937),
    (SegmentKind.ROW, 1, 2, 0.6),
    (SegmentKind.BREAK, 1, 0, 0.2500000003),
    (SegmentKind.RETRACT, -1, 1, 0.5087000034),
)


def made_trajectory(joint_names: tuple[str, ...] = RAIL_AND_SEVEN, **changes: Any) -> Trajectory:
    """Return quintics between random states, at rest at the ends of segments, all different and of any sign."""
    rng = np.random.default_rng(5)
    n = len(joint_names)
    times, rests, segments = [0.0], [0], []
    for kind, row, inner, seconds in _SEGMENTS:
        start = times[-1]
        times += (start + np.linspace(0.0, seconds, inner + 2)[1:]).tolist()
        rests.append(len(times) - 1)
        segments.append(TimedSegment(kind, row, start, times[-1]))
    t = np.array(times)
    states = np.stack([rng.uniform(-s, s, (len(t), n)) for s in (2.5, 1.0, 3.0)])
    states[0, :, 0] *= 0.2
    states[1:, rests] = 0.0
    whole = quintic_coefficients(states, np.diff(t))
    given: dict[str, Any] = {
        "joint_names": joint_names,
        "polynomials": tuple(PPoly(np.ascontiguousarray(whole[:, :, i]), t) for i in range(n)),
        "knots": t,
        "segments": tuple(segments),
        "timing": "quintic",
        "executable": True,
        "reasons": (),
    }
    return Trajectory(**(given | changes))


def units_of(joint_names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the units of the joints: d is a length."""
    return tuple("m" if name.startswith("d") else "rad" for name in joint_names)


def cell_of(joint_names: tuple[str, ...]) -> dict[str, Any]:
    """Return a cell whose arm has these joints of the reference cell's."""
    data = cell_data()
    kept = [k for k, joint in enumerate(data["arm"]["joints"]) if joint["name"] in joint_names]
    data["arm"]["joints"] = [data["arm"]["joints"][k] for k in kept]
    data["arm"]["home"] = [data["arm"]["home"][k] for k in kept]
    return data
