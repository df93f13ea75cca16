"""The step and the pose solver beside pink, mink and TRAC-IK, on the same arm, in one run.

    python -m comparisons.peers [--poses N] [--out FOLDER]

pink (PyPI pin-pink) and mink, both with DAQP, take one differential step with position and velocity limits; qparm
takes the same step in closed form or by its active set, through ProxSuite and through OSQP. The steps are those of
comparisons/step_mixes.py. Then random reachable poses from random starts. A library that is not installed is left
out and said so. Rows are the medians of pairs taken in turn.
"""

from __future__ import annotations

import argparse
import os
import time
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import qparm
from comparisons.extras import load
from comparisons.peer_steppers import Mink, Pink, Stepper
from comparisons.pinocchio_model import pinocchio_model
from comparisons.step_mixes import StepMix, jumps, tracking
from comparisons.tables import save_table
from comparisons.urdf_of_chain import urdf_of_chain
from qparm.ik import DifferentialIK, PoseSolver, solve_poses

_REPETITIONS = 15


def _pairs(a: Callable[[], float], b: Callable[[], float]) -> tuple[float, float, float]:
    times = np.array([(a(), b()) for _ in range(_REPETITIONS)])
    return float(np.median(times[:, 0])), float(np.median(times[:, 1])), float(np.median(times[:, 0] / times[:, 1]))


def _timed(mix: StepMix, step: Callable[[np.ndarray, np.ndarray], object]) -> Callable[[], float]:
    def seconds() -> float:
        start = time.perf_counter()
        for q, target in zip(mix.q, mix.targets, strict=True):
            step(q, target)
        return (time.perf_counter() - start) / len(mix.q)

    return seconds


def _timed_peer(mix: StepMix, peer: Stepper) -> Callable[[], float]:
    configurations = [peer.configuration(q) for q in mix.q]

    def seconds() -> float:
        for configuration, q in zip(configurations, mix.q, strict=True):
            configuration.update(q)
        start = time.perf_counter()
        for configuration, target in zip(configurations, mix.targets, strict=True):
            peer.step(configuration, target)
        return (time.perf_counter() - start) / len(mix.q)

    return seconds


def mixes(cell: qparm.Cell) -> list[StepMix]:
    """Return the steps to be timed: jumps, those of them off and on a bound, and tracking likewise."""
    found = []
    for mix in (jumps(cell.chain()), tracking(cell)):
        found += [mix, mix.only(f"{mix.name}, free", ~mix.bounded), mix.only(f"{mix.name}, bounded", mix.bounded)]
    return found


def single_steps(cell: qparm.Cell) -> list[list[str]]:
    """Return one differential step, by mix and solver, beside pink's, and mink's beside pink's."""
    chain, rows = cell.chain(), []
    for mix in mixes(cell):
        pinks = _timed_peer(mix, Pink(chain, mix.time_step))
        bars = {"auto": "0.10", "proxqp": "0.35"} if "," not in mix.name else {}
        share = f"{mix.name} ({len(mix.q)} steps, {mix.bounded.mean():.0%} at a bound)"
        for name, solver in (("closed form or active set", "auto"), ("ProxSuite", "proxqp"), ("OSQP", "osqp")):
            ik = DifferentialIK(chain, time_step=mix.time_step, solver=solver)
            ours, theirs, ratio = _pairs(_timed(mix, ik.step), pinks)
            bar = bars.get(solver, "-")
            rows.append([f"{share}: {name} / pink", f"{ours * 1e6:.1f}", f"{theirs * 1e6:.1f}", f"{ratio:.3f}", bar])
        if find_spec("mink"):
            ours, theirs, ratio = _pairs(_timed_peer(mix, Mink(chain, mix.time_step)), pinks)
            rows.append([f"{share}: mink / pink", f"{ours * 1e6:.1f}", f"{theirs * 1e6:.1f}", f"{ratio:.3f}", "-"])
    return rows


def compiled_iterations(chain: qparm.SerialChain) -> list[list[str]]:
    """Return unbounded and bounded iterations of the compiled loop over Pinocchio's FK + Jacobian."""
    pin = load("pinocchio")

    model, data, frame = pinocchio_model(chain)
    rng = np.random.default_rng(1)
    middle = 0.5 * (chain.lower + chain.upper) + 0.05 * rng.normal(size=(2000, chain.n)) * chain.scale
    anywhere, elsewhere = chain.random(rng, 2000), chain.forward(chain.random(rng, 2000))
    nearby = chain.forward(middle + 0.05 * rng.normal(size=middle.shape) * chain.scale)
    # tolerances that nothing meets: every start runs until nothing improves, off its bounds or on them
    one: dict[str, Any] = {"method": "dls", "position_tolerance": 1e-18, "rotation_tolerance": 1e-18}

    def ours(
        T: np.ndarray, starts: np.ndarray, least_share: float, most_share: float
    ) -> tuple[Callable[[], float], int]:
        solver = PoseSolver(chain, **one)
        shares = []
        for target, q in zip(T, starts, strict=True):
            counts = solver.solve(target, q).counts
            shares.append(counts.active_set / max(1, counts.total))
        pick = (np.array(shares) >= least_share) & (np.array(shares) <= most_share)
        T, starts = T[pick], starts[pick]

        def seconds() -> float:
            start = time.perf_counter()
            batch = solve_poses(chain, T, starts, restarts=0, threads=1, **one)
            return (time.perf_counter() - start) / batch.iterations.sum()

        return seconds, int(pick.sum())

    def pinocchio() -> float:
        start = time.perf_counter()
        for q in anywhere[:500]:
            pin.computeJointJacobians(model, data, q)
            pin.updateFramePlacement(model, data, frame)
            pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        return (time.perf_counter() - start) / 500

    rows = []
    cases = {"unbounded": (nearby, middle, 0.0, 0.0, "2"), "bounded": (elsewhere, anywhere, 0.9, 1.0, "4")}
    for name, (T, starts, least, most, bar) in cases.items():
        seconds, count = ours(T, starts, least, most)
        a, b, ratio = _pairs(seconds, pinocchio)
        label = f"one {name} iteration / Pinocchio FK + Jacobian ({count} solves)"
        rows.append([label, f"{a * 1e6:.2f}", f"{b * 1e6:.2f}", f"{ratio:.2f}", bar])
    return rows


def poses(chain: qparm.SerialChain, count: int) -> list[list[str]]:
    """Return success and time over random reachable poses from random starts, at most 20 restarts, one core."""
    rng = np.random.default_rng(20231)
    targets = chain.forward(chain.random(rng, count))
    start = time.perf_counter()
    batch = solve_poses(chain, targets, restarts=21, rng=np.random.default_rng(1), threads=1)
    ours = (time.perf_counter() - start) / count
    rows = [
        ["qparm solve_poses, 1e-9, 20 restarts", str(count), f"{batch.reached.mean():.2%}", f"{ours * 1e6:.0f}", "1"]
    ]
    cores = os.cpu_count() or 1
    start = time.perf_counter()
    again = solve_poses(chain, targets, restarts=21, rng=np.random.default_rng(1))
    every = (time.perf_counter() - start) / count
    same = "same answers" if np.array_equal(batch.q, again.q) else "ANSWERS DIFFER"
    rows.append(
        [
            f"... on {cores} cores ({same})",
            str(count),
            f"{again.reached.mean():.2%}",
            f"{every * 1e6:.0f}",
            f"{every / ours:.2f}",
        ]
    )
    few = min(count, 200)
    draws = np.random.default_rng(2)
    if find_spec("pink"):
        pink, reached = Pink(chain, 1.0), 0
        start = time.perf_counter()
        for target in targets[:few]:
            for q in chain.random(draws, 21):
                if pink.solve(target, q, 1e-6, 100) is not None:
                    reached += 1
                    break
        seconds = (time.perf_counter() - start) / few
        rows.append(
            [
                "pink, DAQP, LM 1e-2, 1e-6",
                str(few),
                f"{reached / few:.2%}",
                f"{seconds * 1e6:.0f}",
                f"{seconds / ours:.0f}",
            ]
        )
    if find_spec("pytracik"):
        import pytracik
        from scipy.spatial.transform import Rotation

        # its tolerance is per component: half of ours keeps the norm within 1e-6
        solver = pytracik.TRAC_IK("base", "tool", urdf_of_chain(chain), 0.1, 5e-7, pytracik.SolveType.Speed)
        reached = 0
        start = time.perf_counter()
        for target, q in zip(targets[:few], chain.random(draws, few), strict=True):
            quaternion = Rotation.from_matrix(target[:3, :3]).as_quat()
            reached += pytracik.ik(solver, q, *target[:3, 3], *quaternion)[0] > 0
        seconds = (time.perf_counter() - start) / few
        rows.append(
            [
                "TRAC-IK (pytracik), two threads, 1e-6",
                str(few),
                f"{reached / few:.2%}",
                f"{seconds * 1e6:.0f}",
                f"{seconds / ours:.0f}",
            ]
        )
    return rows


def main() -> None:
    """Print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", type=Path, default=Path("examples/dome.toml"))
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    arguments = parser.parse_args()
    warnings.filterwarnings("ignore")
    cell = qparm.Cell.load(arguments.cell)
    chain = cell.chain()
    for package in ("pink", "mink", "pytracik"):
        if not find_spec(package):
            print(f"{package} is not installed: its rows are left out")
    rows = compiled_iterations(chain)
    if find_spec("pink"):
        rows += single_steps(cell)
    header = ["what", "qparm (us)", "beside (us)", "ratio", "bar"]
    print(save_table(arguments.out, "peers_steps", "Steps beside peers (medians of pairs in one run)", header, rows))
    header = ["solver", "poses", "reached", "us a pose", "relative"]
    title = "Random reachable poses, random starts"
    print(save_table(arguments.out, "peers_poses", title, header, poses(chain, arguments.poses)))


if __name__ == "__main__":
    main()
