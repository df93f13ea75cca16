"""The trajectory as a KUKA program: a data list of positions (.dat), and spline blocks through them (.src)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

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

__all__ = ["KRL_AXES", "krl_files", "write_krl"]

KRL_AXES = tuple(f"A{k}" for k in range(1, 7))
_LANGUAGE = "KUKA KRL"
_WORDS = """
    AND ANIN ANOUT AXIS BOOL BRAKE CASE CHAR CIRC CIRC_REL CONFIRM CONST CONTINUE DECL DEF DEFAULT DEFDAT DEFFCT DELAY
    DIGIN DISTANCE DO ELSE END ENDDAT ENDFCT ENDFOR ENDIF ENDLOOP ENDSPLINE ENDSWITCH ENDWHILE ENUM EXIT EXT EXTFCT
    FALSE FOR FRAME GLOBAL GOTO HALT IF IMPORT INT INTERRUPT IS LIN LIN_REL LOOP MAXIMUM MINIMUM NOT OFF ON OR POS
    PRIO PTP PTP_REL PTP_SPLINE PUBLIC PULSE REAL REPEAT RESUME RETURN SCIRC SIGNAL SLIN SPL SPLINE SPTP STRUC SWITCH
    THEN TIME_BLOCK TO TRIGGER TRUE UNTIL WAIT WHEN WHILE WITH XOR E6AXIS E6POS BAS
"""
# Per cent of the axes' speed on the way to the start, and from there on.
_TO_START, _WHOLE = 10, 100
# Of the shares of a block's time (per cent).
_PART_DIGITS = 9


def krl_files(src: Path) -> tuple[Path, Path]:
    """Return the two files of a program."""
    return src, src.with_suffix(".dat")


def write_krl(sampled: SampledTrajectory, file: Path) -> None:
    """Write ``file`` (.src) and the .dat beside it; degrees to 5 digits, millimetres to 4, block times to 1 us."""
    name = program_name(file.stem, reserved=frozenset(_WORDS.split()), language=_LANGUAGE)
    names = sampled.joint_names
    axes = controller_axes(names, sampled.units, arm=KRL_AXES, external="E1", language=_LANGUAGE)
    q = sampled.derivatives[0]
    lines = [
        ",".join(f"{axis} {value:.{DEGREE_DIGITS}f}" for axis, value in zip(KRL_AXES, row, strict=True))
        for row in axes.degrees(q).tolist()
    ]
    if axes.external is not None:
        external = axes.millimetres(q).tolist()
        lines = [f"{line},E1 {value:.{MILLIMETRE_DIGITS}f}" for line, value in zip(lines, external, strict=True)]
    which = [f"{axis} = {names[joint]} [deg]" for axis, joint in zip(KRL_AXES, axes.arm, strict=True)]
    which += [] if axes.external is None else [f"E1 = {names[axes.external]} [mm]"]
    head = [
        f"; qparm: {len(q)} positions, {sampled.t[-1]:.3f} s",
        f"; {remark(', '.join(which))}",
    ]
    source, data = krl_files(file)
    with data.open("w", encoding="ascii", newline="\r\n") as out:
        out.write(f"&ACCESS RVP\nDEFDAT {name}\n" + "\n".join(head) + "\n")
        out.write(f"DECL {'AXIS' if axes.external is None else 'E6AXIS'} Q[{len(lines)}]\n")
        for k, line in enumerate(lines, 1):
            out.write(f"Q[{k}]={{{line}}}\n")
        out.write("ENDDAT\n")
    with source.open("w", encoding="ascii", newline="\r\n") as out:
        head[0] += "; the time of a block is asked for, the controller takes longer where its own limits say so"
        out.write(f"&ACCESS RVP\nDEF {name}()\n" + "\n".join(head) + "\n")
        # what is set for the way to the start caps the splines too, until it is set back
        out.write(f"BAS(#INITMOV,0)\nBAS(#VEL_PTP,{_TO_START})\nPTP Q[1]\nBAS(#VEL_PTP,{_WHOLE})\n")
        for block in blocks(sampled):
            start, end = (round(float(sampled.t[k]), SECOND_DIGITS) for k in (block.first, block.last))
            out.write(f"; {remark(block.what)}: {start:.3f} s to {end:.3f} s\nPTP_SPLINE\n  TIME_BLOCK START\n")
            t = sampled.t[block.first : block.last + 1]
            # rounded from the start of the block on, so that no rounding adds up along it
            parts = np.diff(np.round(100.0 * (t - t[0]) / (t[-1] - t[0]), _PART_DIGITS))
            for k, part in enumerate(parts.tolist(), block.first + 1):
                out.write(f"  SPTP Q[{k + 1}]\n  TIME_BLOCK PART={part:.{_PART_DIGITS}f}\n")
            out.write(f"  TIME_BLOCK END={end - start:.{SECOND_DIGITS}f}\n")
            out.write("ENDSPLINE\n")
        out.write("END\n")
