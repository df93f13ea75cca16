"""Validation messages: errors of the cell file and of pydantic as key paths and sentences of qparm's own."""

from __future__ import annotations

import difflib
import os
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pydantic

from qparm.errors import CellError, InvalidInput
from qparm.files.reading import SETTINGS_BYTES, MissingFile, parse_toml, read_text, shown, shown_value

__all__ = ["told", "toml_data"]

# pydantic puts the tag of a union into a location although it is no key: of a joint after its index, and of
# these tables after their name
_JOINT_TAGS = frozenset({"prismatic", "revolute"})
_OF_KINDS = frozenset({"arm", "workpiece"})
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
_KINDS = {"type": "'prismatic' or 'revolute'", "shape": "'sphere zone' or 'pose list'"}


def toml_data(source: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what a TOML file holds.

    Raises
    ------
    CellError
        If there is no such file, or it cannot be read, or is not TOML.
    """
    file = Path(source)
    try:
        return parse_toml(read_text(file, largest=SETTINGS_BYTES, empty=True), file)
    except MissingFile:
        sentence = "there is no such file; `qparm new` writes one to start from"
    except InvalidInput as error:
        # the cell is named above, with its whole path
        sentence = str(error).removeprefix(shown(file.name)).lstrip(": ")
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
    location = [part for k, part in enumerate(loc) if not _is_tag(loc, k)]
    kind = problem["type"]
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        location.append(problem["ctx"]["discriminator"].strip("'"))
    if location and location[-1] == "[key]":
        return _key(location[:-1]), problem["msg"] if kind == "cell" else "a key must be a string"
    return _key(location), _sentence(problem, model)


def _is_tag(loc: tuple[Any, ...], k: int) -> bool:
    """Return whether a part of a location is a tag: ``prismatic`` in arm.joints[0].prismatic.position."""
    if k == 1:
        return loc[0] in _OF_KINDS
    return k > 1 and loc[k] in _JOINT_TAGS and isinstance(loc[k - 1], int)


def _key(location: list[Any]) -> str:
    key = ""
    for part in location:
        name = f'"{part}"' if isinstance(part, str) and "." in part else part  # a path as a key, as TOML has it
        name = name if str(name).isprintable() else repr(part)
        key += f"[{part}]" if isinstance(part, int) else f".{name}" if key else str(name)
    return key


def _sentence(problem: Mapping[str, Any], model: type[pydantic.BaseModel]) -> str:
    kind, context, value, loc = problem["type"], problem.get("ctx", {}), problem["input"], problem["loc"]
    if kind == "cell":
        return problem["msg"]
    if kind == "extra_forbidden":
        return f"unknown key{_suggestion(loc, model)}"
    if kind == "invalid_key":
        return "a key must be a string"
    if kind == "missing":
        return "is missing"
    if kind == "literal_error":
        return f"must be {context['expected']}, not {shown_value(value)}"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        key = context["discriminator"].strip("'")
        if kind == "union_tag_not_found":
            return f"is missing: {_KINDS[key]}"
        return f"must be {_KINDS[key]}, not {shown_value(value[key])}"
    if kind == "greater_than_equal":
        return f"must be at least {context['ge']}, not {shown_value(value)}"
    if kind == "less_than_equal":
        return f"must be at most {context['le']}, not {shown_value(value)}"
    if kind == "too_short":
        least = context["min_length"]
        return f"must have at least {least} {'entry' if least == 1 else 'entries'}, not {context['actual_length']}"
    expected = _EXPECTED.get(kind, problem["msg"][0].lower() + problem["msg"][1:])
    return f"{expected}, not {shown_value(value)}"


def _suggestion(loc: tuple[Any, ...], model: type[pydantic.BaseModel]) -> str:
    annotation: Any = model
    for k, part in enumerate(loc[:-1]):
        if isinstance(part, int) or _is_table_of_any(annotation):
            annotation = typing.get_args(annotation)[1] if _is_table_of_any(annotation) else annotation
            continue
        known = _model_in(annotation, part if _is_tag(loc, k) else None)
        if known is None or _is_tag(loc, k):
            annotation = known
            continue
        field = next((f for name, f in known.model_fields.items() if part == (f.alias or name)), None)
        annotation = None if field is None else field.annotation
    known = _model_in(annotation)
    if known is None:
        return ""
    names = [field.alias or name for name, field in known.model_fields.items()]
    near = difflib.get_close_matches(str(loc[-1]), names, n=1)
    return f"; did you mean {near[0]!r}?" if near else f"; known here: {', '.join(names)}"


def _is_table_of_any(annotation: Any) -> bool:
    """Return whether a type is a table whose keys are the user's own."""
    return typing.get_origin(annotation) is dict


def _model_in(annotation: Any, tag: str | None = None) -> type[pydantic.BaseModel] | None:
    """Return the first model in a type, or the one that a tag stands for."""
    if isinstance(annotation, type) and issubclass(annotation, pydantic.BaseModel):
        literals = [typing.get_args(field.annotation) for field in annotation.model_fields.values()]
        return annotation if tag is None or any(tag in words for words in literals) else None
    inner = typing.get_args(annotation)
    if tag is not None and any(isinstance(note, pydantic.Tag) and note.tag == tag for note in inner[1:]):
        return _model_in(inner[0])
    return next(filter(None, (_model_in(one, tag) for one in inner)), None)
