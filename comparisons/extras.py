"""Packages that only some comparisons need: loaded here, and named with what installs them where they are missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["load"]

# What pip installs each module by: an extra of qparm, or the package itself where none has it.
_INSTALLED_BY = {
    "cvxpy": "'.[compare]'",
    "mink": "mink mujoco",
    "mujoco": "mink mujoco",
    "pinocchio": "'.[compare]'",
    "pink": "pin-pink",
    "optuna": "'.[peers]'",
    "pymoo": "'.[peers]'",
}


def load(module: str) -> Any:
    """Return a module, or end the comparison with a sentence that says how to install it."""
    try:
        return import_module(module)
    except ImportError:
        name = module.partition(".")[0]
        raise SystemExit(f"this comparison needs {name}: pip install {_INSTALLED_BY[name]}") from None
