"""Controller programs: every line is a motion that is read, is known to move nothing, or is refused by its number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from made_trajectory import RAIL_AND_SIX, cell_of, made_trajectory, units_of
from qparm.cell import Cell
from qparm.errors import InvalidInput
from qparm.export import export_trajectory
from qparm.verify.motion import MotionTable
from qparm.verify.readers import read_motion

CELL = Cell.load(cell_of(RAIL_AND_SIX))
SIX = Cell.load(cell_of(RAIL_AND_SIX[1:]))
Lines = list[str]


def written(folder: Path, to: str) -> Path:
    file = folder / ("motion.src" if to == "krl" else "motion.mod")
    export_trajectory(made_trajectory(RAIL_AND_SIX), file, to=to, units=units_of(RAIL_AND_SIX))
    return file


def lines_of(file: Path) -> Lines:
    return file.read_bytes().decode("ascii").split("\r\n")


def read_again(file: Path, lines: Lines) -> MotionTable:
    file.write_bytes("\r\n".join(lines).encode("utf-8"))
    return read_motion(file, CELL)


def at(lines: Lines, start: str) -> int:
    """Return the first line that begins with a word."""
    return next(k for k, line in enumerate(lines) if line.strip().startswith(start))


# --- RAPID ----------------------------------------------------------------------------------------------

JOINTS = "[[90,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"


@pytest.mark.parametrize(
    "line",
    [
        "MoveL p9,v1000,z0,tool0;",
        "MoveJ p9,v1000,z0,tool0;",
        "MoveC p8,p9,v1000,z0,tool0;",
        "MoveExtJ p9,v1000,z0;",
        "SearchL di1,p8,p9,v100,tool0;",
        "WaitTime 5;",
        "WaitUntil di1=1;",
        "VelSet 10,100;",
        "AccSet 10,10;",
        "EOffsSet e1;",
        "ActUnit STN1;",
        "reg1:=reg1+1;",
        "FOR i FROM 1 TO 3 DO",
        "IF TRUE THEN",
        "IF reg1=0 motion_1;",
        "WHILE TRUE DO",
        "GOTO again;",
        "again:",
        "RETURN;",
        "Stop;",
        "EXIT;",
        "other_2;",
        "motion_1 5;",
        '%"motion_1"%;',
        'CallByVar "motion_",1;',
        "<SMT>",
        'TPWrite "!"; MoveL p9,v1000,z0,tool0;',
        "SetDO do1,1; MoveL p9,v1000,z0,tool0;",
        f"MoveAbsJ {JOINTS},v1000\\T:=0.05,z0,tool0; MoveL p9,v1000,z0,tool0;",
        f"MoveAbsJ \\Conc,{JOINTS},v1000\\T:=0.05,z0,tool0;",
        f"MoveAbsJ {JOINTS},v1000\\T:=0.05,z0\\Z:=50,tool0;",
        f"MoveAbsJ {JOINTS},v1000\\V:=50,z0,tool0;",
        f"MoveAbsJ {JOINTS}\\Offs:=5,v1000\\T:=0.05,z0,tool0;",
        f"MoveAbsJ Offs({JOINTS}),v1000\\T:=0.05,z0,tool0;",
        f"\0MoveAbsJ {JOINTS},v1000\\T:=0.05,z0,tool0;",
        "! a remark\u2028MoveL p9,v1000,z0,tool0;",
        "! a remark\rMoveL p9,v1000,z0,tool0;",
        "! a remark\x0bMoveL p9,v1000,z0,tool0;",
    ],
)
def test_a_rapid_line_that_is_not_known_to_move_nothing_is_refused(line: str, tmp_path: Path) -> None:
    file = written(tmp_path, "rapid")
    lines = lines_of(file)
    where = at(lines, "PROC motion_2") + 3
    lines.insert(where, line)
    with pytest.raises(InvalidInput, match=f"motion.mod line {where + 1}\\b"):
        read_again(file, lines)


def test_a_rapid_move_without_a_blank_is_read(tmp_path: Path) -> None:
    file = written(tmp_path, "rapid")
    lines, before = lines_of(file), read_motion(file, CELL)
    where = at(lines, "PROC motion_2") + 3
    lines.insert(where, "moveabsj[[90,0,0,0,0,0],[1000,9E9,9E9,9E9,9E9,9E9]],v1000\\T:=0.05,z0,tool0;")
    after = read_again(file, lines)
    assert len(after.t) == len(before.t) + 1
    assert after.t[-1] == pytest.approx(before.t[-1] + 0.05)
    (added,) = np.flatnonzero(np.isclose(after.q[:, 0], np.pi / 2))
    assert np.delete(after.q, added, axis=0).tolist() == before.q.tolist()


def test_a_rapid_move_over_two_lines_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path, "rapid")
    lines = lines_of(file)
    where = at(lines, "PROC motion_2") + 3
    lines[where : where + 1] = lines[where].split(",v1000", 1)
    with pytest.raises(InvalidInput, match=f"line {where + 1} does not end with a semicolon"):
        read_again(file, lines)


def test_rapid_calls_are_followed_in_their_order(tmp_path: Path) -> None:
    file = written(tmp_path, "rapid")
    lines, before = lines_of(file), read_motion(file, CELL)
    first = at(lines, "motion_2;")
    lines[first], lines[first + 1] = lines[first + 1], lines[first]
    after = read_again(file, lines)
    assert after.t[-1] == pytest.approx(before.t[-1])
    assert len(after.q) == len(before.q)
    assert np.abs(after.q - before.q).max() > 0.1
    # procedures may stand in any order; what counts is the calls
    whole = "\n".join(lines_of(written(tmp_path, "rapid")))
    head, *procedures = whole.replace("ENDMODULE\n", "").split("  PROC ")
    moved = head + "".join("  PROC " + one for one in reversed(procedures)) + "ENDMODULE\n"
    assert read_again(file, moved.split("\n")).q.tolist() == before.q.tolist()


def test_a_rapid_procedure_that_is_not_called_leaves_open_what_is_run(tmp_path: Path) -> None:
    file = written(tmp_path, "rapid")
    lines = lines_of(file)
    lines.remove("    motion_2;")
    with pytest.raises(InvalidInput, match=r"called by no other: motion_run \(line 5\), motion_2 .*; which one is run"):
        read_again(file, lines)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [("motion_run;", "every procedure is called"), ("motion_2;", "motion_2 calls itself, without end")],
)
def test_rapid_calls_without_end_are_refused(call: str, sentence: str, tmp_path: Path) -> None:
    file = written(tmp_path, "rapid")
    lines = lines_of(file)
    lines.insert(at(lines, "PROC motion_2") + 1, call)
    with pytest.raises(InvalidInput, match=sentence):
        read_again(file, lines)


@pytest.mark.slow
def test_rapid_calls_that_double_are_bounded(tmp_path: Path) -> None:
    procedures = [f"PROC p{k}()\np{k + 1};\np{k + 1};\nENDPROC" for k in range(60)]
    text = "\n".join(["MODULE m", *procedures, "PROC p60()", "ENDPROC", "ENDMODULE"])
    (tmp_path / "m.mod").write_text(text, encoding="ascii")
    with pytest.raises(InvalidInput, match="the calls make more than"):
        read_motion(tmp_path / "m.mod", SIX)


@pytest.mark.parametrize(
    "line",
    [
        "CONST zonedata z0:=[FALSE,200,300,300,30,300,30];",  # another corner than the name says
        "CONST jointtarget there:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];",
        "VAR num motion_1;",
    ],
)
def test_a_rapid_name_declared_anew_is_refused(line: str, tmp_path: Path) -> None:
    file = written(tmp_path, "rapid")
    lines = lines_of(file)
    lines[1:1] = ["CONST jointtarget there:=[[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];", line]
    with pytest.raises(InvalidInput, match="is declared already"):
        read_again(file, lines)


# --- KRL ------------------------------------------------------------------------------------------------

MOVES_OR_STOPS = [
    "LIN {X 1000,Y 0,Z 0,A 0,B 0,C 0}",
    "LIN Q[3]",
    "CIRC Q[3],Q[4]",
    "PTP_REL {A1 90}",
    "LIN_REL {X 10}",
    "PTP Q[3]",
    "SPTP Q[3]",
    "SLIN Q[3]",
    "SPLINE",
    "WAIT SEC 5",
    "WAIT FOR $IN[1]",
    "HALT",
    "LOOP",
    "FOR I=1 TO 3",
    "WHILE TRUE",
    "REPEAT",
    "IF TRUE THEN",
    "GOTO AGAIN",
    "AGAIN:",
    "OTHER()",
    "$OV_PRO=10",
    "$VEL_AXIS[1]=5",
    "Q[2]=Q[3]",
    "INTERRUPT ON 3",
    "TRIGGER WHEN DISTANCE=0 DELAY=0 DO LIN Q[3]",
    "PTP Q[3] C_PTP",
    "RETURN",
    "PTP_SPLINE WITH $VEL_AXIS[1]=5",
    "PTP_SPLINE C_SPL",
    "BAS(#VEL_PTP,10) LIN Q[3]",
    "\0PTP Q[3]",
    "; a remark\u2028LIN Q[3]",
    "; a remark\rLIN Q[3]",
]


@pytest.mark.parametrize("line", MOVES_OR_STOPS)
def test_a_krl_line_that_is_not_known_to_move_nothing_is_refused(line: str, tmp_path: Path) -> None:
    file = written(tmp_path, "krl")
    lines = lines_of(file)
    where = at(lines, "ENDSPLINE") + 1
    lines.insert(where, line)
    with pytest.raises(InvalidInput, match=f"motion.src line {where + 1}\\b"):
        read_again(file, lines)


@pytest.mark.parametrize(
    "line",
    ["SLIN Q[3]", "SPTP_REL {A1 1}", "PTP Q[3]", "SPTP Q[3] WITH $VEL_AXIS[1]=5", "WAIT SEC 1", "PTP_SPLINE", "END"],
)
def test_a_krl_line_in_a_block_that_is_no_sptp_is_refused(line: str, tmp_path: Path) -> None:
    file = written(tmp_path, "krl")
    lines = lines_of(file)
    where = at(lines, "TIME_BLOCK PART") + 1
    lines.insert(where, line)
    with pytest.raises(InvalidInput, match=f"motion.src line {where + 1}\\b"):
        read_again(file, lines)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("ENDSPLINE\r\n", "", "'PTP_SPLINE' is not read here between TIME_BLOCK END and ENDSPLINE"),
        ("PART=", "PART=0;", "line 13: the time must be greater than zero"),
        ("PART=", "PART=-", "line 13: the time must be greater than zero"),
        ("PART=", "PART=1E999;", "line 13: 1E999 is beyond what any program asks for"),
        ("PART=", "PART=\u0663;", "line 13: '\u0663' outside a comment; programs are ASCII"),
        ("PART=", "PART=1_0;", "line 13: '1_0' is not a number"),
        ("PART=", "PART=nan;", "line 13: 'nan' is not a number"),
        ("TIME_BLOCK START\r\n  SPTP Q[2]", "SPTP Q[2]\r\n  TIME_BLOCK START", "line 12: the time of a block"),
        ("SPTP Q[2]", "SPTP\r\nQ[2]", "line 12: 'SPTP' is not read here in a spline block"),
        ("SPTP Q[2]", "SPTP {X 1000,Y 0,Z 0,A 0,B 0,C 0}", "line 12: the position has no A1"),
        ("SPTP Q[2]", "SPTP {E6POS: X 1000}", "line 12: a position of the type 'E6POS' is not read"),
        ("\r\nEND\r\n", "\r\nEND\r\nDEF other()\r\nEND\r\n", "'DEF other\\(\\)' is not read here after END"),
        ("DEF motion()", "DEF motion(A :IN)", "line 2: .* is not read here before DEF"),
        ("DEF motion()", "DEF other()", "motion.dat is the data list of MOTION, motion.src is the program OTHER"),
    ],
)  # fmt: skip
def test_a_krl_program_that_is_not_whole_is_refused(old: str, new: str, sentence: str, tmp_path: Path) -> None:
    file = written(tmp_path, "krl")
    text = file.read_bytes().decode("ascii")
    assert old in text
    with pytest.raises(InvalidInput, match=sentence):
        read_again(file, text.replace(old, new, 1).split("\r\n"))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("Q[5]={", "Q[5]=\r\n{", "motion.dat line 10: 'Q.5.=' is no declaration"),
        ("Q[5]={A1 ", "Q[5]={A1 0,\r\nA1 ", "motion.dat line 10: .* is no declaration"),
        ("Q[5]=", "Q[4]=", r"motion.dat line 10: the position Q\[4\] is there twice"),
        ("Q[5]={A1 ", "Q[5]={A1 1,A1 ", "line 10: the position has A1 twice"),
        ("Q[5]={A1 ", "Q[5]={A1 9E99;", "line 10: .* is no declaration"),
        ("Q[5]={A1 ", "Q[5]={A1 9E99,A9 ", "line 10: 9E99 is beyond what any program asks for"),
        ("ENDDAT", "", "motion.dat does not end with ENDDAT"),
        ("ENDDAT", "LIN Q[3]\r\nENDDAT", "'LIN Q.3.' is no declaration"),
    ],
)
def test_a_krl_data_list_that_is_not_whole_is_refused(old: str, new: str, sentence: str, tmp_path: Path) -> None:
    data = written(tmp_path, "krl").with_suffix(".dat")
    text = data.read_bytes().decode("ascii")
    assert old in text
    data.write_bytes(text.replace(old, new, 1).encode("ascii"))
    with pytest.raises(InvalidInput, match=sentence):
        read_motion(data, CELL)


@pytest.mark.parametrize("line", ["$OUT[3]=TRUE", "BAS(#TOOL,1)", "BAS (#BASE, 0)", "DECL INT I", "; LIN Q[3]", ""])
def test_a_krl_line_that_moves_nothing_changes_nothing(line: str, tmp_path: Path) -> None:
    file = written(tmp_path, "krl")
    lines, before = lines_of(file), read_motion(file, CELL)
    lines.insert(at(lines, "ENDSPLINE") + 1, line)
    after = read_again(file, lines)
    assert (after.t.tolist(), after.q.tolist()) == (before.t.tolist(), before.q.tolist())


@pytest.mark.parametrize("line", ["SetDO do1,1;", "Set do1;", "Reset do1;", "! MoveL p9,v1000,z0,tool0;", ""])
def test_a_rapid_line_that_moves_nothing_changes_nothing(line: str, tmp_path: Path) -> None:
    file = written(tmp_path, "rapid")
    lines, before = lines_of(file), read_motion(file, CELL)
    lines.insert(at(lines, "PROC motion_2") + 3, line)
    after = read_again(file, lines)
    assert (after.t.tolist(), after.q.tolist()) == (before.t.tolist(), before.q.tolist())


def test_a_krl_program_runs_its_splines_at_the_whole_speed_of_the_axes(tmp_path: Path) -> None:
    lines = lines_of(written(tmp_path, "krl"))
    before, first = lines[: at(lines, "PTP Q[1]")], lines[at(lines, "PTP Q[1]") : at(lines, "PTP_SPLINE")]
    assert "BAS(#VEL_PTP,10)" in before
    assert "BAS(#VEL_PTP,100)" in first
    # and one that does not is told so
    slow = [line for line in lines if line != "BAS(#VEL_PTP,100)"]
    told = read_again(tmp_path / "motion.src", slow).not_told
    assert any("VEL_PTP of 10 %" in one for one in told)
    assert not any("VEL_PTP" in one for one in read_again(tmp_path / "motion.src", lines).not_told)


@pytest.mark.parametrize("to", ["krl", "rapid"])
def test_a_program_has_no_zero_with_a_sign(to: str, tmp_path: Path) -> None:
    file = tmp_path / ("motion.src" if to == "krl" else "motion.mod")
    still = made_trajectory(RAIL_AND_SIX)
    for polynomial in still.polynomials:
        polynomial.c *= -1e-12
    export_trajectory(still, file, to=to, units=units_of(RAIL_AND_SIX))
    text = "".join(one.read_text(encoding="ascii") for one in tmp_path.iterdir())
    assert "0.00000" in text
    assert "-0.0000" not in text
