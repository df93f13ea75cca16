"""Many poses: the same answers as one by one, on any number of threads."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

import qparm
from qparm.ik import PoseStatus, solve_pose, solve_poses
from qparm.verify.kinematics import joint_transforms, rotation_angle


@pytest.fixture(scope="module")
def targets(chain: qparm.SerialChain) -> np.ndarray:
    return chain.forward(chain.random(np.random.default_rng(6), 1000))


def test_random_reachable_poses_are_reached(chain: qparm.SerialChain, dome: qparm.Cell, targets: np.ndarray) -> None:
    batch = solve_poses(chain, targets, restarts=21, rng=np.random.default_rng(1))
    assert batch.reached.sum() >= 999
    poses, _ = joint_transforms(dome, batch.q[batch.reached])
    wanted = targets[batch.reached]
    assert np.linalg.norm(poses[:, :3, 3] - wanted[:, :3, 3], axis=1).max() <= 1.1e-9
    assert rotation_angle(wanted[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1)).max() <= 1.1e-9
    assert chain.within_limits(batch.q).all()


@pytest.mark.parametrize("method", ["dls", "wln", "cwln", "gpm"])
def test_the_same_answers_on_any_number_of_threads(chain: qparm.SerialChain, targets: np.ndarray, method: str) -> None:
    runs = [
        solve_poses(chain, targets[:200], method=method, restarts=5, rng=np.random.default_rng(2), threads=threads)
        for threads in (1, 2, 7)
    ]
    for run in runs[1:]:
        for name in ("q", "end", "position_error", "iterations", "starts"):
            np.testing.assert_array_equal(getattr(run, name), getattr(runs[0], name))


def test_the_same_answers_one_by_one(chain: qparm.SerialChain, targets: np.ndarray) -> None:
    starts = chain.random(np.random.default_rng(3), 60)
    batch = solve_poses(chain, targets[:60], starts, restarts=0, method="cwln")
    for k in range(60):
        one = solve_pose(chain, targets[k], starts[k], method="cwln")
        np.testing.assert_array_equal(batch.q[k], one.q)
        assert batch.status[k] is one.status
        assert batch.iterations[k] == one.iterations


def test_every_start_is_kept_when_asked_for(chain: qparm.SerialChain, targets: np.ndarray) -> None:
    batch = solve_poses(chain, targets[:3], restarts=50, rng=np.random.default_rng(4), every_start=True)
    assert batch.q.shape == (3, 50, 8)
    assert batch.reached.shape == batch.status.shape == (3, 50)
    assert batch.reached.sum() > 30
    solved = batch.q[0, batch.reached[0]]
    assert np.ptp(solved, axis=0).max() > 0.5, "different starts lead to different solutions"
    np.testing.assert_allclose(chain.forward(solved), np.repeat(targets[:1], len(solved), axis=0), atol=1e-8)


def test_verdicts_are_those_of_one_pose(chain: qparm.SerialChain) -> None:
    beyond = np.eye(4)
    beyond[:3, 3] = 0.0, 3.0, 0.5
    batch = solve_poses(chain, [beyond], restarts=3, rng=np.random.default_rng(0))
    assert batch.status[0] is PoseStatus.UNREACHABLE
    assert not batch.reached[0]
    assert batch.starts[0] == 3


def test_the_gil_is_released(chain: qparm.SerialChain, targets: np.ndarray) -> None:
    """Python goes on while a batch is solved: it would not, if the kernel kept the lock."""
    many = np.repeat(targets, 4, axis=0)
    ticks, done = [], threading.Event()

    def tick() -> None:
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    start = time.perf_counter()
    solve_poses(chain, many, restarts=5, rng=np.random.default_rng(5), threads=1)
    end = time.perf_counter()
    done.set()
    thread.join()
    inside = [t for t in ticks if start < t < end]
    assert len(inside) > 5


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"targets": np.eye(4)}, r"\(N, 4, 4\)"),
        ({"targets": np.full((1, 4, 4), np.nan)}, "not finite"),
        ({"starts": np.zeros((2, 8))}, r"starts must be \(1, 8\)"),
        ({"starts": np.full((1, 8), np.nan)}, "start 0 of pose 0, joint 'd1'"),
        ({"rng": None}, "restarts need rng"),
        ({"restarts": 0}, "no start"),
        ({"restarts": -1}, "restarts not negative"),
        ({"threads": 0}, "threads"),
        ({"method": "newton"}, "method"),
        ({"method": ["dls"]}, "method"),
        ({"position_tolerance": None}, "position_tolerance"),
        ({"position_tolerance": np.nan}, "position_tolerance"),
    ],
)
def test_unusable_input_is_refused_by_name(chain: qparm.SerialChain, change: dict, words: str) -> None:
    arguments = {"targets": np.eye(4)[None], "restarts": 2, "rng": np.random.default_rng(0)} | change
    with pytest.raises(qparm.InvalidInput, match=words):
        solve_poses(chain, arguments.pop("targets"), arguments.pop("starts", None), **arguments)
