"""The rule for names, wherever one enters: cells, URDFs, headers of tables, trajectories.

A name is printed, heads columns of tables and stands in comments of programs. One that breaks the line or holds what
a terminal or a controller takes for a command is refused where it enters, so that no writer has to think of it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

__all__ = ["LONGEST_NAME", "wrong_joint_name", "wrong_joint_names", "wrong_name"]

# Characters.
LONGEST_NAME = 100
_JOINT = re.compile(r"\w(?:[\w./ -]*[\w./-])?")
# Columns of tables that are no joint's.
_COLUMNS = ("t", "time", "time_s", "timestamp", "time_from_start", "row", "segment", "process_on")


def wrong_name(value: object) -> str:
    """Return why something cannot be a name, as a sentence; empty if it can.

    A name is a text of 1 to 100 characters that can be printed, on one line, without blanks at its ends.
    """
    if not isinstance(value, str):
        return f"a name is a text, not {str(value)[:LONGEST_NAME]!r}"
    if not value:
        return "must have at least 1 character"
    if len(value) > LONGEST_NAME:
        return f"{value[:40]!r}... has {len(value)} characters; a name has {LONGEST_NAME} at most"
    if not value.isprintable():
        return f"{value!r} has a character that cannot be printed"
    if value != value.strip():
        return f"{value!r} has blanks at its ends"
    return ""


def wrong_joint_name(value: object) -> str:
    """Return why something cannot be a joint's name, as a sentence; empty if it can.

    Letters, digits, ``_ - . /`` and blanks within, as what heads a column of a table; not what heads another one.
    """
    wrong = wrong_name(value)
    if wrong:
        return wrong
    assert isinstance(value, str)
    if not _JOINT.fullmatch(value):
        return (
            f"{value!r} cannot be a joint's name: letters, digits, '_', '-', '.', '/' and blanks within (it heads"
            " columns of tables)"
        )
    if value.lower() in _COLUMNS:
        return f"{value!r} cannot be a joint's name: tables have another column of this name"
    return ""


def wrong_joint_names(values: Iterable[object]) -> str:
    """Return why names cannot be those of the joints of one motion; empty if they can."""
    names = list(values)
    wrong = next(filter(None, map(wrong_joint_name, names)), "")
    if wrong:
        return wrong
    twice = sorted({str(name) for name in names if names.count(name) > 1})
    return f"joint names must differ; repeated: {', '.join(twice)}" if twice else ""
