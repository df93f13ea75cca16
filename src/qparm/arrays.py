"""Arrays that come from callers: real numbers in a regular table, or a sentence that says what is wrong with them."""

from __future__ import annotations

from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["real_array"]


def real_array(values: ArrayLike, *, what: str) -> NDArray[np.float64]:
    """Return values as a C-contiguous float64 array.

    Parameters
    ----------
    values : array_like
    what : str
        Named in errors.

    Raises
    ------
    InvalidInput
        If they are text, complex or ragged, or a masked array hides some of them: a mask would be dropped in silence.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return np.ascontiguousarray(values)
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise InvalidInput(f"{what} is a masked array with {int(np.ma.count_masked(values))} values hidden; fill them")
    try:
        array = np.asarray(values)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(f"{what} must be a regular table of numbers; its parts are not of one length") from None
    if array.dtype.kind not in "fiub":
        try:  # numbers of other kinds, such as Fraction
            if array.dtype.kind == "O" and all(isinstance(x, Real) for x in array.flat):
                return np.ascontiguousarray(array, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            pass
        kinds = {"c": "complex numbers", "U": "text", "S": "text", "O": "objects", "M": "dates", "m": "durations"}
        raise InvalidInput(f"{what} must be real numbers, not {kinds.get(array.dtype.kind, str(array.dtype))}")
    return np.ascontiguousarray(array, dtype=np.float64)
