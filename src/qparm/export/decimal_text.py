"""Numbers as decimal text, many at a time: as ``%.12g`` writes them (zero without a sign), compiled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import c2, ci1, cu1, i8, kernel, kernel_helper, ou1

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["lines_of"]

_DIGITS = 12
# sign, digits, point, exponent (or as many leading zeros), comma
_WIDEST = 1 + _DIGITS + 1 + 5 + 1
# Powers of ten up to this are exact, and large numbers times them do not overflow when they are split in two halves.
_EXACT, _SPLIT = 22, 134217729.0
_ZERO, _MINUS, _PLUS, _POINT, _COMMA, _E, _NEWLINE = (ord(c) for c in "0-+.,e\n")


@kernel_helper
def power_of_ten(k):
    """Return 10^k, exact up to 10^22."""
    result, base = 1.0, 10.0
    while k > 0:
        if k % 2:
            result *= base
        base *= base
        k //= 2
    return result


@kernel_helper
def product_error(a, b, p):
    """Return a b - p for the rounded product p, exactly (Dekker 1971)."""
    t = _SPLIT * a
    a0 = t - (t - a)
    t = _SPLIT * b
    b0 = t - (t - b)
    a1, b1 = a - a0, b - b0
    return ((a0 * b0 - p) + a0 * b1 + a1 * b0) + a1 * b1


@kernel_helper
def rounded(x, k):
    """Return x 10^k rounded to a whole number; halves are told from what is nearly one by what rounding took away."""
    high, low = x, 0.0
    while k != 0:
        step = min(abs(k), _EXACT)
        power = power_of_ten(step)
        if k > 0:
            p = high * power
            low = low * power + product_error(high, power, p)
            k -= step
        else:
            p = high / power
            q = p * power
            low = ((high - q) - product_error(p, power, q) + low) / power
            k += step
        high = p
    whole = np.floor(high)
    over = (high - whole - 0.5) + low
    if over > 0.0 or (over == 0.0 and whole % 2.0 == 1.0):
        whole += 1.0
    return int(whole)


@kernel_helper
def write_number(x, out, at):
    """Write a finite number and return where its text ends."""
    if x < 0:
        out[at] = _MINUS
        at += 1
        x = -x
    if x == 0.0:
        out[at] = _ZERO
        return at + 1
    exponent = int(np.floor(np.log10(x)))
    whole = rounded(x, _DIGITS - 1 - exponent)
    # the logarithm is rounded, and so is the number: either may pass a power of ten
    if whole >= 10**_DIGITS:
        exponent += 1
        whole = rounded(x, _DIGITS - 1 - exponent)
    elif whole < 10 ** (_DIGITS - 1):
        exponent -= 1
        whole = rounded(x, _DIGITS - 1 - exponent)
    digits = _DIGITS
    while whole % 10 == 0:
        whole //= 10
        digits -= 1
    fixed = -4 <= exponent < _DIGITS
    before = exponent + 1 if fixed else 1  # digits before the point
    if before <= 0:
        out[at], out[at + 1] = _ZERO, _POINT
        at += 2
        for _ in range(-before):
            out[at] = _ZERO
            at += 1
        for k in range(digits - 1, -1, -1):
            out[at + k] = _ZERO + whole % 10
            whole //= 10
        return at + digits
    length = max(digits, before)
    for _ in range(length - digits):
        whole *= 10
    point = before < length
    for k in range(length - 1, -1, -1):
        out[at + k + (1 if point and k >= before else 0)] = _ZERO + whole % 10
        whole //= 10
    at += length
    if point:
        out[at + before - length] = _POINT
        at += 1
    if not fixed:
        out[at] = _E
        out[at + 1] = _MINUS if exponent < 0 else _PLUS
        exponent = abs(exponent)
        places = 3 if exponent >= 100 else 2
        for k in range(places, 0, -1):
            out[at + 1 + k] = _ZERO + exponent % 10
            exponent //= 10
        at += 2 + places
    return at


@kernel(i8(c2, ci1, cu1, ci1, ou1))
def write_lines(table, kind, tails, tail_at, out):
    """Write a line of numbers after another, each with a tail, and return the length of the text.

    table (k, c); kind (k,): which tail a line has; tails: their text, one after another; tail_at (t + 1,): where each
    begins, and the last one ends.
    """
    at = 0
    for k in range(table.shape[0]):
        for c in range(table.shape[1]):
            at = write_number(table[k, c], out, at)
            out[at] = _COMMA
            at += 1
        for c in range(tail_at[kind[k]], tail_at[kind[k] + 1]):
            out[at] = tails[c]
            at += 1
        out[at] = _NEWLINE
        at += 1
    return at


def lines_of(table: NDArray[np.float64], kind: NDArray[np.int64], tails: Sequence[str]) -> bytes:
    """Return numbers as lines of text: comma-separated, to 12 significant digits, as ``%.12g`` does.

    Parameters
    ----------
    table : (k, c) ndarray
        Finite.
    kind : (k,) ndarray of int
        Which of the tails each line ends with.
    tails : sequence of str
        Further columns.

    Raises
    ------
    ValueError
        If a number is not finite.

    Examples
    --------
    >>> lines_of(np.array([[0.5, -2e-9], [1e15, 0.0]]), np.array([0, 1]), ["a", "b,c"]).decode().split()
    ['0.5,-2e-09,a', '1e+15,0,b,c']
    """
    if not np.isfinite(table).all():
        raise ValueError("a table of numbers holds one that is not finite")
    texts = [tail.encode() for tail in tails]
    tail_at = np.concatenate([[0], np.cumsum([len(text) for text in texts])]).astype(np.int64)
    widest = max((len(text) for text in texts), default=0)
    out = np.empty(len(table) * (table.shape[1] * _WIDEST + widest + 1) + 1, dtype=np.uint8)
    length = write_lines(
        np.ascontiguousarray(table, dtype=np.float64), np.ascontiguousarray(kind, dtype=np.int64),
        np.frombuffer(b"".join(texts), dtype=np.uint8), tail_at, out,
    )  # fmt: skip
    return out[:length].tobytes()
