"""From what a file says to a section of the schema, with one line for what does not fit."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .errors import ConfigError, nearest, short
from .schema.section import Section

S = TypeVar("S", bound=Section)


def validated(
    path: Path, document: dict[str, Any], kind: type[S], words: Callable[[str], str]
) -> S:
    """Return the section that a table is.

    `words` turns a complaint that begins with a key of the table into one that begins with the
    file's. Raises `ConfigError`.
    """
    try:
        # Through JSON, because only there strict means: no text for a number, a list for a tuple.
        return kind.model_validate_json(json.dumps(document, default=str), strict=True)
    except ValidationError as error:
        # A misspelt required key shows twice, as missing and as unknown: the second helps more.
        found = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
        told = dict.fromkeys(f"{path}: {words(_explain(one, kind))}" for one in found)
        raise ConfigError(*told) from None


def under(place: str, words: str) -> str:
    """Return a complaint that begins with a key of the table at `place`, by the file's key."""
    return place + words if words.startswith(":") else f"{place}.{words}"


def _explain(error: ErrorDetails, kind: type[BaseModel]) -> str:
    loc = error["loc"]
    key = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in loc).removeprefix(".")
    names = [p for p in loc if isinstance(p, str)]
    section, field = _section_of(names, kind)
    if error["type"] == "extra_forbidden":
        known = () if section is None else section.model_fields
        return f"{key}: unknown key{nearest(names[-1], known)}"
    meaning = ""
    if section is not None and field in section.model_fields:
        meaning = section.model_fields[field].description or ""
    if error["type"] == "missing":
        return f"{key}: missing" + (f": {meaning}" if meaning else "")
    message = error["msg"].removeprefix("Value error, ").removeprefix("Input ")
    value = error["input"]
    shown = "" if isinstance(value, dict) else f"value {short(value)}: "
    return f"{key}: {shown}{message}" + (f" ({meaning})" if meaning else "")


def _section_of(names: list[str], kind: type[BaseModel]) -> tuple[type[BaseModel] | None, str]:
    """Return the section that holds the last of the keys which the schema knows, and that key."""
    section: type[BaseModel] | None = kind
    for name in names[:-1]:
        field = None if section is None else section.model_fields.get(name)
        inner = None if field is None else _section_in(field.annotation)
        if inner is None:
            return (section, name) if field is not None else (None, name)
        section = inner
    return section, names[-1] if names else ""


def _section_in(annotation: object) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((s for s in map(_section_in, get_args(annotation)) if s is not None), None)
