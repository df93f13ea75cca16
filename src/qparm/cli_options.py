"""Options that several commands read alike."""

from __future__ import annotations

from qparm.errors import InvalidInput

__all__ = ["period_seconds"]


def period_seconds(text: str) -> float:
    """Return a time such as ``"4 ms"`` in seconds, or raise InvalidInput if no samples can be that far apart."""
    from qparm.units import parse_quantity

    try:
        seconds = parse_quantity(text, "time")
    except ValueError as error:
        raise InvalidInput(f"--period: {error}") from None
    if not 1e-4 <= seconds <= 10.0:
        raise InvalidInput(f"--period: must lie between 0.1 ms and 10 s, not {text!r}")
    return seconds
