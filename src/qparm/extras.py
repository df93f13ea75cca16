"""Packages that only some formats need: loaded when they are used, and named when they are missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from qparm.errors import PackageMissing

__all__ = ["load_extra"]

# Module: what pip calls its package, and the extra of qparm that brings it.
_EXTRAS = {
    "lz4": ("lz4", "ros"),
    "mcap": ("mcap-ros2-support", "ros"),
    "mcap_ros2": ("mcap-ros2-support", "ros"),
    "pyarrow": ("pyarrow", "parquet"),
    "rosbags": ("rosbags", "ros"),
    "zstandard": ("zstandard", "ros"),
    "yaml": ("PyYAML", "ros"),
}


def load_extra(module: str, *, instead: str) -> Any:
    """Return a module of an optional package.

    Parameters
    ----------
    module : str
        Such as ``"pyarrow.parquet"``.
    instead : str
        What works without it, as an instruction.

    Raises
    ------
    PackageMissing
        With the extra to install.
    """
    package, extra = _EXTRAS[module.partition(".")[0]]
    try:
        return import_module(module)
    except ImportError:
        raise PackageMissing(package, instead, extra=extra) from None
