"""TOML files of people: read whole, judged by the schema, or refused in one line."""

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .errors import ConfigError, nearest, short
from .schema.section import Section

# --- TOML files of people: read whole, or refused in one line, however they are made --------------

LONGEST_FILE: Final = 1 << 20
"""A file of more bytes is none that a person wrote [1]."""
DEEPEST: Final = 24
"""Tables and lists are not nested more deeply than this [1]."""
_GREATEST: Final = 2**63
_PART: Final = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_DEEP_KEY: Final = re.compile(
    rf"^[ \t]*\[{{0,2}}[ \t]*{_PART}(?:[ \t]*\.[ \t]*{_PART}){{{DEEPEST}}}"
    rf"|[{{,][ \t]*{_PART}(?:[ \t]*\.[ \t]*{_PART}){{{DEEPEST}}}",
    re.MULTILINE,
)
"""A key of more parts than tables may be deep: it takes `tomllib` minutes."""


def read_toml(path: Path) -> dict[str, Any]:
    """Return what a TOML file says. Raises `ConfigError` for one that cannot be read."""
    try:
        size = path.stat().st_size
        if size > LONGEST_FILE:
            raise ConfigError(f"{path}: {size} bytes: must be at most {LONGEST_FILE}")
        text = path.read_text(encoding="utf-8")
        if (deep := _DEEP_KEY.search(text)) is not None:
            raise ConfigError(f"{path}: {_short(deep[0].strip())}: nested more than {DEEPEST} deep")
        document = tomllib.loads(text)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: byte {error.start}: not UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not TOML: {_short(str(error))}") from None
    except RecursionError:
        raise ConfigError(f"{path}: nested more than {DEEPEST} deep") from None
    except ValueError as error:  # an integer of more digits than Python converts
        raise ConfigError(f"{path}: not TOML: {_short(str(error))}") from None
    _check(path, document)
    return document


def _check(path: Path, document: dict[str, Any]) -> None:
    """Raise `ConfigError` for integers beyond TOML's 64 bits, and for bottomless nesting."""
    waiting: list[tuple[str, Any, int]] = [("", document, 0)]
    while waiting:
        key, value, depth = waiting.pop()
        if depth > DEEPEST:
            raise ConfigError(f"{path}: {_short(key)}: nested more than {DEEPEST} deep")
        if isinstance(value, dict):
            prefix = f"{key}." if key else ""
            waiting += [(f"{prefix}{name}", inner, depth + 1) for name, inner in value.items()]
        elif isinstance(value, list):
            waiting += [(f"{key}[{i}]", inner, depth + 1) for i, inner in enumerate(value)]
        elif isinstance(value, int) and not -_GREATEST <= value < _GREATEST:
            raise ConfigError(f"{path}: {_short(key)}: an integer of more than 64 bits")


def _short(text: str) -> str:
    return text if len(text) <= 100 else text[:99] + "…"


# --- From what a file says to a section of the schema, with one line for what does not fit --------

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
