"""Names of a room that are loaded when they are asked for, so that importing the room stays quick."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

__all__ = ["on_demand"]


def on_demand(
    room: str, homes: Mapping[str, str], names: Sequence[str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the ``__getattr__`` and the ``__dir__`` of a room.

    Parameters
    ----------
    room : str
        Its ``__name__``.
    homes : mapping of str to str
        The module of the room, or the room below it, that a name is loaded from.
    names : sequence of str
        All public names of the room, ``__all__``.
    """

    def load(name: str) -> Any:
        home = homes.get(name)
        if home is None:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f"{room}.{home}"), name)

    def public() -> list[str]:
        return sorted(names)

    return load, public
