"""The share of the rows that is worked: the length on which the tool follows them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.verify.finding import Findings
    from qparm.verify.following import Following

__all__ = ["NOT_WORKED", "check_rows_worked", "worked_lengths"]

# The name of the line in the table of checks.
NOT_WORKED = "length of rows not worked"
# A stretch begins and ends between two places that are looked at: a row is worked whole to this share of its length.
_WHOLE = 1e-3


def worked_lengths(tool_path: ToolPath, following: Following) -> NDArray[np.float64]:
    """Return the length of each row on which the tool follows it, (rows,), m."""
    worked = np.zeros(len(tool_path.rows))
    for piece in following.pieces:
        if piece.kind == "row" and len(piece.s) > 1:
            worked[piece.row] += float(piece.s.max() - piece.s.min())
    length = np.array([row.length for row in tool_path.rows])
    return np.where(worked >= length * (1 - _WHOLE), length, worked)


def check_rows_worked(tool_path: ToolPath, following: Following, findings: Findings) -> None:
    """Tell how much of the rows is not worked, and find rows of which nothing is.

    A break inside a row costs the stretch between two of its points, and may be what the arm needs; a row of which
    nothing is worked was not carried out at all.
    """
    length = np.array([row.length for row in tool_path.rows])
    worked = worked_lengths(tool_path, following)
    missing = length - worked
    worst = int(missing.argmax())
    where = f"of {length.sum() * 1e3:.6g} mm" + (
        f", most of it on row {worst}: {missing[worst] * 1e3:.4g} of {length[worst] * 1e3:.4g} mm"
        if missing[worst] > 0
        else ""
    )
    findings.check(NOT_WORKED, float(missing.sum()), float("nan"), "m", where)
    points = np.bincount(tool_path.row_of_point, minlength=len(length))
    for row in np.flatnonzero((points > 1) & (length > 0) & (worked <= 0)).tolist():
        findings.wrong("row-not-worked", f"row {row}", "the tool works nothing of it", float("nan"), float("nan"),
                       float("nan"), "")  # fmt: skip
