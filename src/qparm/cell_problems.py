"""What is wrong with a cell, told: errors of the file and of pydantic as key paths and sentences of qparm's own."""

from __future__ import annotations

import difflib
import os
import tomllib
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pydantic

from qparm.errors import CellError

__all__ = ["told", "toml_data"]

# union tags that pydantic puts into a location although they are no keys
_TAGS = frozenset({"prismatic", "revolute"})
_EXPECTED = {
    "dict_type": "must be a table",
    "model_attributes_type": "must be a table",
    "model_type": "must be a table",
    "tuple_type": "must be a list",
    "string_type": "must be a string",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_parsing_size": "must be a whole number",
    "finite_number": "must be a whole number",
}
_LONGEST_SHOWN = 60


def toml_data(source: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what a TOML file holds.

    Raises
    ------
    CellError
        If there is no such file, or it cannot be read, or is not TOML.
    """
    try:
        with Path(source).open("rb") as file:
            return tomllib.load(file)
    except FileNotFoundError:
        sentence = "there is no such file; `qparm new` writes one to start from"
    except OSError as error:
        sentence = f"cannot be read: {error.strerror}"
    except UnicodeDecodeError as error:
        sentence = f"is not UTF-8 text: byte {error.start} cannot be read"
    except tomllib.TOMLDecodeError as error:
        sentence = f"is not valid TOML: {error}"
    except RecursionError:
        sentence = "is not a cell: its lists or tables are nested too deeply"
    except ValueError as error:  # a name that no file can have
        sentence = f"cannot be read: {error}"
    raise CellError(str(source), [("", sentence)])


def told(problem: Mapping[str, Any], model: type[pydantic.BaseModel]) -> tuple[str, str]:
    """Return key path and sentence of one of pydantic's errors.

    Parameters
    ----------
    problem : mapping
        One of ``ValidationError.errors()``.
    model : type of pydantic.BaseModel
        What was validated: it knows the keys that unknown ones are compared with.

    Returns
    -------
    (str, str)
        The path, such as ``"arm.joints[3].velocity"``, and what is wrong there.
    """
    loc = problem["loc"]
    # the tag follows the joint's index: arm.joints[0].prismatic.position
    location = [part for k, part in enumerate(loc) if not (part in _TAGS and k and isinstance(loc[k - 1], int))]
    kind = problem["type"]
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        location.append("type")
    if location and location[-1] == "[key]":
        return _key(location[:-1]), "a key must be a string"
    return _key(location), _sentence(problem, location, model)


def _key(location: list[Any]) -> str:
    key = ""
    for part in location:
        key += f"[{part}]" if isinstance(part, int) else f".{part}" if key else str(part)
    return key


def _sentence(problem: Mapping[str, Any], location: list[Any], model: type[pydantic.BaseModel]) -> str:
    kind, context, value = problem["type"], problem.get("ctx", {}), problem["input"]
    if kind == "cell":
        return problem["msg"]
    if kind == "extra_forbidden":
        return f"unknown key{_suggestion(location, model)}"
    if kind == "invalid_key":
        return "a key must be a string"
    if kind == "missing":
        return "is missing"
    if kind == "literal_error":
        return f"must be {context['expected']}, not {_shown(value)}"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        if "type" not in value:
            return "is missing: 'prismatic' or 'revolute'"
        return f"must be 'prismatic' or 'revolute', not {_shown(value['type'])}"
    if kind == "greater_than_equal":
        return f"must be at least {context['ge']}, not {_shown(value)}"
    if kind == "less_than_equal":
        return f"must be at most {context['le']}, not {_shown(value)}"
    if kind == "too_short":
        least = context["min_length"]
        return f"must have at least {least} {'entry' if least == 1 else 'entries'}, not {context['actual_length']}"
    expected = _EXPECTED.get(kind, problem["msg"][0].lower() + problem["msg"][1:])
    return f"{expected}, not {_shown(value)}"


def _shown(value: object) -> str:
    """Return how a value is named that is not what it should be."""
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, (list, tuple)):
        return "a list"
    if isinstance(value, bool):
        return str(value).lower()
    text = repr(value) if isinstance(value, str) else str(value)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}..."


def _suggestion(location: list[Any], model: type[pydantic.BaseModel]) -> str:
    known: Any = model
    for part in location[:-1]:
        if isinstance(part, int):
            continue
        field = next((f for name, f in known.model_fields.items() if part == (f.alias or name)), None)
        known = _model_in(field.annotation) if field is not None else None
        if known is None:
            return ""
    names = [field.alias or name for name, field in known.model_fields.items()]
    near = difflib.get_close_matches(str(location[-1]), names, n=1)
    return f"; did you mean {near[0]!r}?" if near else f"; known here: {', '.join(names)}"


def _model_in(annotation: Any) -> type[pydantic.BaseModel] | None:
    """Return the first model in a type: of a list of joints a joint, whose keys are those of all kinds."""
    if isinstance(annotation, type) and issubclass(annotation, pydantic.BaseModel):
        return annotation
    return next(filter(None, map(_model_in, typing.get_args(annotation))), None)
