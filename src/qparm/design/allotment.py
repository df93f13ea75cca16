"""The shares of a study's budget: the search, the border of the valid designs, and what is looked at besides."""

from __future__ import annotations

from dataclasses import dataclass

from qparm.errors import InvalidInput

__all__ = ["Allotment", "allotted"]

# The border's share where none is asked for, and the most that it gets then.
_BORDER, _MOST_BORDER = 0.25, 100


@dataclass(frozen=True)
class Allotment:
    """Designs to evaluate, at most; their sum is the budget.

    Attributes
    ----------
    search : int
        What the engine proposes.
    border : int
        Along the border of the valid designs to the shortest; what the search leaves over goes here too.
    beside : int
        A step to either side of the recommended design in every variable: has it reserve?
    own : int
        The cell as it stands: 1.
    """

    search: int
    border: int
    beside: int
    own: int


def allotted(budget: int, d: int, *, border: int | None, followed: bool) -> Allotment:
    """Return how a budget is shared out.

    Parameters
    ----------
    budget : int
        In all.
    d : int
        Variables.
    border : int, optional
        Kept for the border; by default a quarter of the budget, at most 100.
    followed : bool
        Whether the border can be followed: length is an objective, and known without an evaluation.

    Raises
    ------
    InvalidInput
        Nothing would be left to search with.
    """
    beside = 2 * d if budget >= 4 * (2 * d + 1) else 0
    if border is None:
        border = min(int(_BORDER * budget), _MOST_BORDER)
    if not followed:
        border = 0
    search = budget - border - beside - 1
    if search < 1:
        raise InvalidInput(
            f"a budget of {budget} leaves no design to search with: {border} to follow the border, {beside} beside the"
            f" recommended design and the cell's own are taken off; at least {budget + 1 - search} are needed"
        )
    return Allotment(search, border, beside, 1)
