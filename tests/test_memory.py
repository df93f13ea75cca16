"""Kernels read no memory but what they were given and have written: as plain Python, with every new array filled anew.

Compiled code neither checks its indices nor clears its arrays: what it reads beyond an array, or before it has
written there, is whatever was in that memory, and the answer changes from run to run. As plain Python the first is an
``IndexError``, and the second an answer that depends on what new arrays are filled with.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.slow

FILLINGS = ("nan", "0.5")


def _cases() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield what is run in the child: names, and calls that give arrays."""
    import qparm
    from qparm.ik import DifferentialIK, solve_poses
    from qparm.path.relaxation import EXACT, Relaxation
    from qparm.planning.search.projection import project
    from qparm.planning.search.sampling import Sampling, sample_block
    from qparm.reach import attainable_margin, reach_of_designs

    cell = qparm.Cell.load(Path(__file__).parents[1] / "examples" / "dome.toml")
    chain, poses = cell.chain(), cell.tool_path().poses[400:403]
    free = Relaxation(tilt=0.1, spin=True)
    rng = np.random.default_rng(1)
    starts = chain.random(rng, 6).reshape(3, 2, chain.n)

    def samples(fresh: int, where_empty: int, relaxation: Relaxation, targets: np.ndarray) -> list[np.ndarray]:
        sampling = Sampling(spacing=0.2, starts=2, fresh=fresh, fresh_where_empty=where_empty, most=400)
        layers = sample_block(chain, targets, rng=np.random.default_rng(0), sampling=sampling, relaxation=relaxation)
        return [part for layer in layers for part in (layer.q, layer.rho)]

    # the middle pose is out of reach: the next has no solutions to start from
    broken = poses.copy()
    broken[1, 2, 3] += 5.0
    for fresh, where_empty in ((1, 3), (4, 2)):  # more where there are none, and fewer
        for relaxation in (EXACT, free):
            name = f"samples, {fresh} and {where_empty} new{', free' if relaxation.free else ''}"
            yield name, lambda f=fresh, w=where_empty, r=relaxation: samples(f, w, r, poses)
            yield f"{name}, a gap", lambda f=fresh, w=where_empty, r=relaxation: samples(f, w, r, broken)
    yield "projection", lambda: project(chain, poses, starts, position_tolerance=1e-7, rotation_tolerance=1e-7)
    yield "margin", lambda: attainable_margin(chain, poses[:2], starts=starts[:2], climbs=1, threads=1).margin
    yield "reach", lambda: reach_of_designs([chain], broken, restarts=2, threads=1).reached
    yield "reach, free", lambda: reach_of_designs([chain], poses, relaxation=free, restarts=2, threads=1).reached
    for method in ("dls", "wln", "cwln", "gpm"):
        yield f"poses, {method}", lambda m=method: solve_poses(chain, poses, starts, method=m, restarts=0).q
    yield "differential", lambda: DifferentialIK(chain, time_step=0.05).step(starts[0, 0], poses[0]).q


def child(filling: float) -> None:
    """Print a digest of every case, with new arrays filled."""
    empty = np.empty

    def filled(shape: Any, dtype: Any = float, **options: Any) -> np.ndarray:
        out = empty(shape, dtype, **options)
        if out.dtype.kind in "fi":
            out.fill(filling if out.dtype.kind == "f" else 12345)
        return out

    np.empty = filled
    for name, call in _cases():
        found = call()
        parts = found if isinstance(found, (list, tuple)) else [found]
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()
        print(f"{name}: {digest} {sum(np.size(part) for part in parts)}")


@pytest.fixture(scope="module")
def told() -> dict[str, list[str]]:
    """Return what the child prints with each filling."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    out: dict[str, list[str]] = {}
    for filling in FILLINGS:
        command = [sys.executable, __file__, filling]
        done = subprocess.run(command, env=environment, text=True, capture_output=True, check=False, timeout=300)
        assert done.returncode == 0, done.stderr[-2000:]
        out[filling] = done.stdout.splitlines()
    return out


def test_no_answer_depends_on_what_new_memory_holds(told: dict[str, list[str]]) -> None:
    first = told[FILLINGS[0]]
    assert len(first) > 10
    assert all(lines == first for lines in told.values())


def test_every_case_answers(told: dict[str, list[str]]) -> None:
    assert all(int(line.rsplit(" ", 1)[1]) > 0 for line in told[FILLINGS[0]])


if __name__ == "__main__":
    child(float(sys.argv[1]))
