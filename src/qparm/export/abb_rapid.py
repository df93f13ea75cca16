"""The trajectory as an ABB RAPID module: one procedure for every run without a stop, each move with its time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from qparm.export.controller_program import (
    DEGREE_DIGITS,
    MILLIMETRE_DIGITS,
    SECOND_DIGITS,
    blocks,
    controller_axes,
    program_name,
    remark,
)

if TYPE_CHECKING:
    from qparm.export.sampled import SampledTrajectory

__all__ = ["RAPID_AXES", "write_rapid"]

RAPID_AXES = tuple(f"rax_{k}" for k in range(1, 7))
_LANGUAGE = "ABB RAPID"
_WORDS = """
    ALIAS AND BACKWARD CASE CONNECT CONST DEFAULT DIV DO ELSE ELSEIF ENDFOR ENDFUNC ENDIF ENDMODULE ENDPROC ENDRECORD
    ENDTEST ENDTRAP ENDWHILE ERROR EXIT FALSE FOR FROM FUNC GOTO IF INOUT LOCAL MOD MODULE NOSTEPIN NOT NOVIEW OR PERS
    PROC RAISE READONLY RECORD RETRY RETURN STEP SYSMODULE TASK TEST THEN TO TRAP TRUE TRYNEXT UNDO VAR VIEWONLY WHILE
    WITH XOR MAIN MOVEABSJ
"""
_NO_AXIS = "9E+09"


def write_rapid(sampled: SampledTrajectory, file: Path) -> None:
    r"""Write ``MoveAbsJ`` with ``\T``; degrees to 5 digits, millimetres to 4, times to 1 us from the start."""
    name = program_name(file.stem, reserved=frozenset(_WORDS.split()), language=_LANGUAGE)
    names = sampled.joint_names
    axes = controller_axes(names, sampled.units, arm=RAPID_AXES, external="eax_a", language=_LANGUAGE)
    q = sampled.derivatives[0]
    arm = [",".join(f"{value:.{DEGREE_DIGITS}f}" for value in row) for row in axes.degrees(q).tolist()]
    if axes.external is None:
        external = [_NO_AXIS] * len(q)
    else:
        external = [f"{value:.{MILLIMETRE_DIGITS}f}" for value in axes.millimetres(q).tolist()]
    targets = [f"[[{a}],[{','.join([e, *[_NO_AXIS] * 5])}]]" for a, e in zip(arm, external, strict=True)]
    which = [f"{axis} = {names[joint]} [deg]" for axis, joint in zip(RAPID_AXES, axes.arm, strict=True)]
    which += [] if axes.external is None else [f"eax_a = {names[axes.external]} [mm]"]
    times = [round(t, SECOND_DIGITS) for t in sampled.t.tolist()]
    with file.open("w", encoding="ascii", newline="\r\n") as out:
        out.write(f"MODULE {name}\n  ! qparm: {len(q)} positions, {times[-1]:.3f} s\n  ! {remark(', '.join(which))}\n")
        out.write("  ! the time of a move is asked for; the controller takes longer where its own limits say so\n")
        runs = blocks(sampled)
        out.write(f"  PROC {name}_run()\n    ! to the start, slowly\n")
        out.write(f"    MoveAbsJ {targets[0]}\\NoEOffs,v100,fine,tool0;\n")
        for number in range(1, len(runs) + 1):
            out.write(f"    {name}_{number};\n")
        out.write("  ENDPROC\n")
        for number, block in enumerate(runs, 1):
            out.write(f"  PROC {name}_{number}()\n    ! {remark(block.what)}: {times[block.first]:.3f} s to")
            out.write(f" {times[block.last]:.3f} s\n")
            for k in range(block.first + 1, block.last + 1):
                zone = "fine" if k == block.last else "z0"
                step = f"{times[k] - times[k - 1]:.{SECOND_DIGITS}f}"
                out.write(f"    MoveAbsJ {targets[k]}\\NoEOffs,v1000\\T:={step},{zone},tool0;\n")
            out.write("  ENDPROC\n")
        out.write("ENDMODULE\n")
