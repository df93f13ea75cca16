"""Work shared among cores, for kernels that release the GIL."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

__all__ = ["in_threads"]


def in_threads(solve: Callable[[int, int], None], count: int, chunk: int, threads: int | None = None) -> None:
    """Call ``solve(first, last)`` for all of ``count``, a chunk at a time.

    Parameters
    ----------
    solve : callable
        May run beside itself on other spans.
    count, chunk : int
    threads : int, optional
        All cores by default; one runs everything in the caller's.
    """
    spans = [(first, min(first + chunk, count)) for first in range(0, count, chunk)]
    workers = min(threads or os.cpu_count() or 1, max(1, len(spans)))
    if workers == 1:
        for span in spans:
            solve(*span)
        return
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(lambda span: solve(*span), spans))
