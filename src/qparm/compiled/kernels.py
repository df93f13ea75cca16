"""Compilation of the kernels: one decorator, explicit signatures, a cache on disk.

A kernel with an explicit signature is compiled when its module is imported (or loaded from numba's
cache, tens of milliseconds), never in the middle of a plan. Importing a module of kernels is
therefore put off until something is computed.

When you change a kernel that another *file* calls, delete the ``__pycache__`` folders: numba's cache
watches only the file of the caller.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit, types
from numba.core.event import Event, Listener, register

from qparm.compiled import beside
from qparm.compiled.notice import compilation_begins, compilation_ends, not_kept

# fmt: off
__all__ = [
    "b1", "c1", "c2", "c3", "c4", "ci1", "ci2", "cu1", "f8", "i8", "kernel", "kernel_helper", "o1", "o2", "o3", "o4",
    "oi", "oi2", "ou1", "void",
]
# fmt: on

# The words of the signatures. Inputs (c for const) accept read-only arrays too, outputs (o) do not;
# all are C-contiguous.
void, f8, i8 = types.void, types.float64, types.int64
c1, c2, c3, c4 = (types.Array(f8, ndim, "C", readonly=True) for ndim in (1, 2, 3, 4))
b1 = types.Array(types.boolean, 1, "C", readonly=True)
o1, o2, o3, o4 = (types.Array(f8, ndim, "C") for ndim in (1, 2, 3, 4))
oi, oi2 = (types.Array(i8, ndim, "C") for ndim in (1, 2))
ci1, ci2 = (types.Array(i8, ndim, "C", readonly=True) for ndim in (1, 2))
# text
cu1, ou1 = types.Array(types.uint8, 1, "C", readonly=True), types.Array(types.uint8, 1, "C")


class _Notice(Listener):
    """Tells of every kernel that numba compiles; those that it finds in its cache it only loads."""

    def on_start(self, event: Event) -> None:
        beside.begin()
        dispatcher = (event.data or {}).get("dispatcher")
        compilation_begins(getattr(dispatcher, "__name__", "kernel"))

    def on_end(self, event: Event) -> None:
        compilation_ends()


register("numba:compile", _Notice())

F = TypeVar("F", bound=Callable[..., Any])


def kernel(signature: Any) -> Callable[[F], F]:
    """Compile a function for one explicit signature, cached, without the GIL.

    ``error_model="numpy"`` lets a division by zero give inf, as in NumPy; ``fastmath`` stays off, so
    NaN is never optimised away and the same input gives the same bits.
    """

    def compiled(function: F) -> F:
        beside.wait_for(function.__module__)
        options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": False}
        try:
            return njit(signature, cache=True, **options)(function)  # type: ignore[return-value]
        except ModuleNotFoundError:  # cached before a module that it calls into was given another name
            return _cached_anew(signature, options, function)
        except RuntimeError:  # no folder to cache in: neither the source's nor the user's can be written
            not_kept()
            return njit(signature, **options)(function)  # type: ignore[return-value]

    return compiled


def _cached_anew(signature: Any, options: dict[str, Any], function: F) -> F:
    """Compile a function and replace what the cache holds of it."""
    dispatcher: Any = njit(cache=True, **options)(function)
    try:
        dispatcher._cache.flush()
        dispatcher.compile(signature)
    except OSError:  # what is cached can be read, not replaced
        return njit(signature, **options)(function)  # type: ignore[return-value]
    dispatcher.disable_compile()
    return dispatcher


def kernel_helper(function: F) -> F:
    """Compile a function that only other kernels call (inlined by LLVM, cached with its callers)."""
    return njit(nogil=True, error_model="numpy", fastmath=False)(function)  # type: ignore[return-value]
