"""The judge of random cells: on its own, and one that finds what is wrong."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparisons.soak.__main__ import bars, numbers
from comparisons.soak.cells import generate, toml
from comparisons.soak.feed import Judge, judge_feed
from comparisons.soak.kinematics import Cell

import qparm
from conftest import ROOT

DOME = ROOT / "examples" / "dome.toml"


@pytest.fixture(scope="module")
def cell() -> Cell:
    return Cell(DOME)


def test_nothing_of_it_imports_qparm() -> None:
    files = sorted((ROOT / "comparisons" / "soak").glob("*.py"))
    assert len(files) > 5
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.split(".")[0] == "qparm" for name in names), file


def test_its_kinematics_are_those_of_the_documents(cell: Cell) -> None:
    chain = qparm.Cell.load(DOME).chain()
    q = chain.random(np.random.default_rng(1), 5)
    p, r = cell.fk(q)
    assert np.abs(chain.forward(q)[:, :3, 3] - p).max() < 1e-12
    assert np.abs(chain.forward(q)[:, :3, :3] - r).max() < 1e-12
    assert np.abs(chain.jacobian(q) - cell.jacobian(q)[2]).max() < 1e-12


@pytest.mark.slow
def test_cells_come_again_by_their_number(tmp_path: Path) -> None:
    (document, options), again = generate(3), generate(3)
    assert again == (document, options)
    assert toml(document) != toml(generate(4)[0])
    file = tmp_path / "cell.toml"
    file.write_text(toml(document), encoding="utf-8")
    assert qparm.Cell.load(file).process.rows == Cell(file).rows


def passed(
    cell: Cell, speed: float, *, share: float = 0.0, said: dict[str, Any] | None = None, later: float = 0.0
) -> list[str]:
    """Return what is wrong with a row passed at a share of the feed, theta2 at a share of its acceleration."""
    t = np.arange(0.0, 10.0, 0.02)
    states = [np.tile(cell.home, (len(t), 1)), *(np.zeros((len(t), len(cell.names))) for _ in range(3))]
    states[1][:, 0] = cell.feed * speed * np.where(t > later, 1.0, 1.0 / speed)
    states[2][:, 1] = share * cell.amax[1]
    judge = Judge()
    report = {"measured": {"feed": {"rows": [said] if said else []}}}
    judge_feed(judge, cell, report, 4, t, states, np.linspace(*cell.azimuth, len(t)))
    return judge.wrong


def test_the_feed_may_give_way_to_a_limit_alone(cell: Cell) -> None:
    assert passed(cell, 1.0) == []
    assert "1.0100 times as fast" in passed(cell, 1.01, share=1.0)[0]
    assert "0.9000 of it on row 4" in passed(cell, 0.9)[0]
    assert "largest share of a joint's limit 0.300" in passed(cell, 0.9, share=0.3)[0]
    assert passed(cell, 0.9, share=0.99) == []
    assert "at 5.0" in passed(cell, 0.9, later=5.0)[0]


def test_a_joint_that_is_named_must_be_near_its_limit(cell: Cell) -> None:
    said = {"row": 4, "joint": "theta2", "limit": "acceleration", "time": 5.0}
    assert passed(cell, 0.9, share=0.99, said=said) == []
    wrong = passed(cell, 0.9, share=0.99, said=said | {"joint": "theta3"})
    assert len(wrong) == 1
    assert "because of the acceleration of theta3, which has a share of 0.000" in wrong[0]
    assert passed(cell, 0.9, share=0.99, said=said | {"row": 5, "joint": "theta3"}) == []


def test_bars_are_judged() -> None:
    def cells(name: str, count: int, **more: Any) -> list[dict[str, Any]]:
        return [{"k": k, "class": name, "why": [], **more} for k in range(count)]

    def kept(done: list[dict[str, Any]], differing: tuple[int, ...] = ()) -> list[bool]:
        return [ok for *_, ok in bars(done, differing)]

    fine = cells("valid", 98) + cells("invalid, other", 2) + cells("invalid, out of reach", 9) + cells("refused", 3)
    assert kept(fine) == [True] * 5
    assert kept([*fine, *cells("valid but wrong", 1)])[0] is False
    assert kept([*fine, *cells("crash", 1)])[1] is False
    assert kept([*fine, *cells("invalid, points within reach", 1)])[2] is False
    assert kept([*fine, *cells("valid", 1, needless=[3])])[3] is False
    assert kept(fine, (7,))[4] is False
    assert list(numbers("3:6")) == [3, 4, 5]
    assert list(numbers("8")) == [8]
