"""Evaluations shared among workers: joblib's processes, or whatever backend the caller has set.

    with joblib.parallel_config(backend="dask"):
        design(cell)

Results are written down as they come and handed back in the order of asking, so the number of workers changes nothing
but the time. Where a worker dies, what it had not finished is done again.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from qparm.design.evaluate import Evaluation, evaluate
from qparm.design.journal import Journal
from qparm.design.space import DesignSpace
from qparm.errors import QparmError

__all__ = ["Order", "WorkersLost", "evaluate_all"]

# Deaths of workers in a row, without a single result between them, after which something else is wrong.
_MOST_DEATHS = 3


@dataclass(frozen=True)
class Order:
    """What is wanted of every design.

    Attributes
    ----------
    level : int
    names : tuple of str
    seed : int
    """

    level: int
    names: tuple[str, ...]
    seed: int


class WorkersLost(QparmError, RuntimeError):
    """Workers died again and again; what was finished is in the journal."""


def evaluate_all(
    space: DesignSpace,
    designs: Sequence[Sequence[float]],
    order: Order,
    journal: Journal,
    *,
    workers: int | None = None,
    finished: Callable[[Evaluation], None] | None = None,
) -> list[Evaluation]:
    """Return the evaluations of some designs, in their order.

    Parameters
    ----------
    space : DesignSpace
    designs : sequence of (d,) sequences of float
    order : Order
    journal : Journal
        What it knows is not done again; what is done is written to it at once.
    workers : int, optional
        Processes; 1 evaluates here. By default what the backend offers: all cores, or the cluster's.
    finished : callable, optional
        Told every evaluation as it is finished.

    Raises
    ------
    WorkersLost
        If workers die and nothing gets done.
    """
    designs = [tuple(float(value) for value in x) for x in designs]
    deaths = 0
    while True:
        open_ = [x for x in dict.fromkeys(designs) if not ((e := journal.get(x)) and e.knows(order.level, order.names))]
        if not open_:
            found = [journal.get(x) for x in designs]
            return [one for one in found if one is not None]
        done = 0
        try:
            for evaluation in _run(space, open_, order, journal, workers):
                journal.add(evaluation)
                done += 1
                if finished is not None:
                    finished(evaluation)
        except Exception as error:
            if not _is_death(error):
                raise
            deaths = 1 if done else deaths + 1
            if deaths >= _MOST_DEATHS:
                raise WorkersLost(
                    f"workers died {deaths} times without finishing a design ({error}); fewer workers may need less"
                    " memory; what was finished is in the journal"
                ) from error


def _run(
    space: DesignSpace, designs: Sequence[tuple[float, ...]], order: Order, journal: Journal, workers: int | None
) -> Iterator[Evaluation]:
    """Yield evaluations as they are finished."""
    if workers == 1:
        for x in designs:
            yield _evaluated(space, x, order, journal.get(x))
        return
    from joblib import Parallel, delayed, parallel_config
    from joblib.parallel import get_active_backend

    jobs = _jobs(workers)
    # processes of this machine end with the one that starts them, before their first design too; a cluster's go on
    local = type(get_active_backend()[0]).__name__ == "LokyBackend"
    ends = {"backend": "loky", "initializer": _end_with, "initargs": (os.getpid(),)} if local else {}
    bare = DesignSpace(space.cell, space.design)  # without what is worked out from it: it goes to every worker
    with parallel_config(**ends):
        parallel = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)  # pyright: ignore[reportArgumentType]
        for found in parallel(delayed(_evaluated)(bare, x, order, journal.get(x)) for x in designs):
            assert found is not None
            yield found


def _jobs(workers: int | None) -> int | None:
    """Return joblib's ``n_jobs``: what was asked for, else the caller's configuration, else all there are."""
    from joblib.parallel import get_active_backend

    # without a number in a configuration joblib would take one worker (1 before its version 1.6, None from it on)
    return workers or (-1 if get_active_backend()[1] in (None, 1) else None)


def _evaluated(space: DesignSpace, x: tuple[float, ...], order: Order, known: Evaluation | None) -> Evaluation:
    return evaluate(space, x, level=order.level, names=order.names, seed=order.seed, known=known)


def _end_with(parent: int) -> None:
    """Let this process end when the one that started it is gone, however that ended."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _is_death(error: Exception) -> bool:
    """Return whether an error says that a worker died, of loky's or of a cluster's."""
    return type(error).__name__ in ("TerminatedWorkerError", "BrokenProcessPool", "KilledWorker")
