"""Compiled kernels: the decorator with explicit signatures and a cache, the notice of a first run, and threads."""

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand

if TYPE_CHECKING:
    from qparm.compiled.kernels import kernel, kernel_helper
    from qparm.compiled.notice import compilation_notice
    from qparm.compiled.threads import in_threads

__all__ = ["compilation_notice", "in_threads", "kernel", "kernel_helper"]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "compilation_notice": "notice",
        "in_threads": "threads",
        "kernel": "kernels",
        "kernel_helper": "kernels",
    },
    __all__,
)
