"""What the tests share: the reference cell, its arm, plans made once."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qparm

ROOT = Path(__file__).resolve().parents[1]
DOME = ROOT / "examples" / "dome.toml"


@pytest.fixture(scope="session", autouse=True)
def _signals_are_not_ignored() -> None:
    """Whoever starts the tests in the background, or with nohup, has their children ignore signals."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler if name == "SIGINT" else signal.SIG_DFL)


@pytest.fixture(scope="session")
def dome() -> qparm.Cell:
    return qparm.Cell.load(DOME)


@pytest.fixture(scope="session")
def chain(dome: qparm.Cell) -> qparm.SerialChain:
    return dome.chain()


@pytest.fixture(scope="session")
def dome_plan(dome: qparm.Cell) -> qparm.Plan:
    """Plan the reference cell as the command does, seed 0."""
    return qparm.plan(dome, seed=0)


@pytest.fixture(scope="session")
def general_plan(dome: qparm.Cell) -> qparm.Plan:
    """Plan the reference cell by the general method, seed 0, keeping the iterates of every step."""
    return qparm.plan(dome, strategy="general", seed=0, keep_traces=True)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20231)


def few_rows(**process: Any) -> dict[str, Any]:
    """Return a small piece of the reference cell that every strategy can do."""
    data = cell_data()
    data["workpiece"] |= {"elevation": ["20 deg", "40 deg"], "azimuth": ["-10 deg", "10 deg"]}
    data["process"] |= {"rows": 3, "points": 11} | process
    return data


def speeds_along(curve: Any, length: float, *, places: Any = None) -> np.ndarray:
    """Return |dx/ds| of the tool point at places of a curve of poses: differences over 10 um, to the fourth order."""
    s, h = np.linspace(5e-5, length - 5e-5, 997) if places is None else places, 1e-5

    def mean(step: float) -> np.ndarray:
        return (curve(s + step)[:, :3, 3] - curve(s - step)[:, :3, 3]) / (2 * step)

    return np.linalg.norm((4 * mean(h) - mean(2 * h)) / 3, axis=1)


def cell_data(path: Path = DOME) -> dict:
    """Return a cell file as a dictionary to be changed."""
    import tomllib

    return tomllib.loads(path.read_text(encoding="utf-8"))
