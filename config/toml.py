"""TOML files of people: read whole, or refused in one line, however they are made."""

import re
import tomllib
from pathlib import Path
from typing import Any, Final

from .errors import ConfigError

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
