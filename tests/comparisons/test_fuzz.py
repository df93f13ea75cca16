"""The fuzzer's own parts: inputs that come back the same, and a verdict that sees what is wrong."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from comparisons.fuzz import Ended, _in_child
from comparisons.fuzz_mutations import mutated, mutated_arguments
from comparisons.fuzz_seeds import KINDS, LIMITS, WAYPOINTS


@pytest.mark.parametrize("binary", [True, False])
def test_an_index_gives_the_same_input_again(binary: bool) -> None:
    data = WAYPOINTS.encode()
    made = [mutated(data, random.Random(f"0/{k}"), binary=binary, suffix=".csv") for k in range(300)]
    assert made == [mutated(data, random.Random(f"0/{k}"), binary=binary, suffix=".csv") for k in range(300)]
    assert len(set(made)) > 200
    options = [mutated_arguments(random.Random(k)) for k in range(300)]
    assert options == [mutated_arguments(random.Random(k)) for k in range(300)]


@pytest.mark.parametrize(
    ("ended", "faults"),
    [
        (Ended(0, 0.1, 0, "well"), ()),
        (Ended(2, 5.9, 2**30, "qparm: m.csv is empty"), ()),
        (Ended(1, 0.1, 0, "Traceback (most recent call last):"), ("traceback", "exit 1")),
        (Ended(-9, 0.1, 0, ""), ("code -9",)),
        (Ended(2, 6.1, 0, ""), ("CPU",)),
        (Ended(2, 0.1, 2**30 + 1, ""), ("memory",)),
        (Ended(2, 0.1, 0, "m.npz cannot be read: it asks for more memory than there is"), ("memory",)),
        (Ended(0, 0.1, 0, "x.py:3: RuntimeWarning: divide by zero"), ("warning",)),
    ],
)
def test_what_is_wrong_with_a_run_is_seen(ended: Ended, faults: tuple[str, ...]) -> None:
    assert ended.faults == faults


def test_a_command_in_a_child_tells_its_code_and_what_it_said(tmp_path: Path) -> None:
    import json

    (tmp_path / "w.csv").write_text(WAYPOINTS, encoding="utf-8")
    (tmp_path / "l.json").write_text(json.dumps(LIMITS | {"jerk": [1, "x"]}), encoding="utf-8")
    kind = next(kind for kind in KINDS if kind.name == "limits, json")
    ended = _in_child(["time", "w.csv", "--limits", "l.json", "--out", "o.csv"], kind, tmp_path)
    assert (ended.code, ended.faults) == (2, ())
    assert "l.json: the jerk limit of joint 1 must be a number, not 'x'" in ended.text
