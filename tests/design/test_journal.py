"""The journal: what was finished is kept, whatever happens to the file's last line."""

import pytest

from conftest import DOME
from qparm.design.evaluate import Evaluation
from qparm.design.journal import Journal, problem_hash, set_aside
from qparm.design.space import DesignSpace
from qparm.errors import InvalidInput, OutputError


def evaluation(x, **changes):
    values = {
        "x": x, "level": 2, "violation": 0.0, "coverage": 1.0, "missed": 0, "checked": 9, "reason": "",
        "measures": {"length": 0.1 + x[0]}, "seconds": {0: 0.5},
    }  # fmt: skip
    return Evaluation(**(values | changes))


def test_what_is_written_is_read_back_to_the_same_bits(tmp_path):
    one = evaluation((0.1 + 0.2, 1 / 3))
    Journal("p", tmp_path / "j").add(one)
    again = Journal("p", tmp_path / "j")
    assert again.get(one.x) == one
    assert again.get((0.3, 1 / 3)) is None  # 0.1 + 0.2 is another number


def test_a_torn_last_line_is_passed_over_and_the_next_starts_anew(tmp_path):
    file = tmp_path / "j"
    journal = Journal("p", file)
    for k in range(3):
        journal.add(evaluation((float(k),)))
    whole = file.read_bytes()
    for cut in (1, 20, len(whole.splitlines(keepends=True)[-1]) - 1):
        file.write_bytes(whole[:-cut])
        again = Journal("p", file)
        assert sorted(one.x for one in again.known.values()) == [(0.0,), (1.0,)] or cut == 1
        again.add(evaluation((7.0,)))
        assert Journal("p", file).get((7.0,)) == evaluation((7.0,))
        assert Journal("p", file).get((1.0,)) == evaluation((1.0,))


def test_a_later_line_of_a_design_holds(tmp_path):
    journal = Journal("p", tmp_path / "j")
    journal.add(evaluation((1.0,)))
    journal.add(evaluation((1.0,), level=3))
    found = Journal("p", tmp_path / "j").get((1.0,))
    assert found is not None
    assert found.level == 3


def test_lines_of_another_problem_are_kept_and_not_used(tmp_path):
    Journal("p", tmp_path / "j").add(evaluation((1.0,)))
    other = Journal("q", tmp_path / "j")
    assert other.get((1.0,)) is None
    other.add(evaluation((1.0,), violation=0.5))
    found = Journal("p", tmp_path / "j").get((1.0,))
    assert found is not None
    assert found.valid


def test_times_are_no_part_of_what_was_found():
    a, b = Journal("p"), Journal("p")
    a.add(evaluation((1.0,)))
    a.add(evaluation((2.0,)))
    b.add(evaluation((2.0,), seconds={}))
    b.add(evaluation((1.0,), seconds={0: 9.0}))
    assert a.digest() == b.digest()
    b.add(evaluation((3.0,)))
    assert a.digest() != b.digest()


def test_what_is_no_journal_is_refused_and_left_alone(tmp_path):
    file = tmp_path / "j"
    file.write_text("name,value\na,1\nb,2\n")
    with pytest.raises(InvalidInput, match="not a journal"):
        Journal("p", file)
    assert file.read_text() == "name,value\na,1\nb,2\n"


def test_a_torn_first_line_does_not_block_a_good_journal(tmp_path):
    file = tmp_path / "j"
    journal = Journal("p", file)
    for k in range(3):
        journal.add(evaluation((float(k),)))
    lines = file.read_bytes().splitlines(keepends=True)
    for torn in (lines[0][:30] + b"\n", b"\0" * 40 + b"\n", b"gar{bage\n"):
        file.write_bytes(torn + b"".join(lines[1:]))
        again = Journal("p", file)
        assert sorted(one.x for one in again.known.values()) == [(1.0,), (2.0,)]
        assert again.torn == 1
    # all that a run could write before it was killed
    file.write_bytes(lines[0][:30])
    assert not Journal("p", file).known
    assert Journal("q", file).torn == 1


def test_designs_of_other_problems_are_counted(tmp_path):
    journal = Journal("q", tmp_path / "j")
    for x in (1.0, 2.0, 2.0):
        journal.add(evaluation((x,)))
    again = Journal("p", tmp_path / "j")
    assert (len(again.known), again.others, again.torn) == (0, 2, 0)


def test_a_journal_begun_anew_sets_the_old_one_aside_at_its_first_line_and_overwrites_none(tmp_path):
    file = tmp_path / "journal.jsonl"
    Journal("p", file).add(evaluation((0.0,)))
    for k in range(3):
        old = file.read_bytes()
        anew = Journal("p", file, anew=True)
        assert file.read_bytes() == old, "nothing is moved before something is written"
        assert len(set_aside(file)) == k
        assert not anew.known
        anew.add(evaluation((k + 1.0,)))
        anew.add(evaluation((k + 1.5,)))
        assert [other.name for other in set_aside(file)] == [f"journal.before-{i + 1}.jsonl" for i in range(k + 1)]
        assert set_aside(file)[-1].read_bytes() == old
        assert len(file.read_bytes().splitlines()) == 2


def test_a_journal_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(OutputError):
        Journal("p", tmp_path / "missing" / "j")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError):
        Journal("p", tmp_path / "folder")


def test_the_hash_is_of_what_an_evaluation_depends_on():
    space = DesignSpace.of(DOME)
    other_range = DesignSpace.of(DOME, ranges={"arm.lengths.L1": ("480 mm", "600 mm")})
    moved = DesignSpace.of(space.cell.with_values({"arm.lengths.L2": 0.41}), ranges={"arm.lengths.L1": ("1 m", "2 m")})
    assert problem_hash(space, 0) == problem_hash(other_range, 0)
    assert problem_hash(space, 0) != problem_hash(space, 1)
    assert problem_hash(space, 0) != problem_hash(moved, 0)


@pytest.mark.parametrize(
    "changes", [{"measures": {}}, {"measures": {"lengdh": 1.1}}, {"level": 4}, {"violation": -0.5}], ids=str
)
def test_a_line_that_lacks_what_its_level_tells_is_not_used(changes, tmp_path):
    Journal("p", tmp_path / "j").add(evaluation((1.0,), **changes))
    again = Journal("p", tmp_path / "j")
    assert (again.torn, again.known) == (1, {})
    # a design that is not a valid cell has no measures
    again.add(evaluation((1.0,), level=0, violation=10.0, measures={}))
    found = Journal("p", tmp_path / "j").get((1.0,))
    assert found is not None
    assert not found.valid
