"""Tables of the schema, `config/reference.md`: `python -m laboratory.equipment.reference`."""

import types
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic.fields import FieldInfo
from telerobot.config.schema import cell as schema
from telerobot.config.schema.section import PoseSection, Section

BEGIN: Final = "<!-- begin: made by `python -m laboratory.equipment.reference` -->"
END: Final = "<!-- end -->"
PAGE: Final = Path(schema.__file__).parents[1] / "reference.md"
_WORDS: Final = {float: "number", int: "integer", str: "text", bool: "true or false"}
_SIGNS: Final = {Ge: "≥", Gt: ">", Le: "≤", Lt: "<"}


def reference() -> str:
    """Return Markdown: a heading and a table for every section of a cell file."""
    return "\n".join(_section(schema.CellConfig, "", is_list=False))


def updated(text: str) -> str:
    """Return a page with what stands between the markers made anew.

    Raises `ValueError` if the page lacks a marker.
    """
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page needs the lines {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{reference()}\n{END}{after}"


def main() -> None:
    """Bring the page up to date."""
    PAGE.write_text(updated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def _section(section: type[Section], path: str, is_list: bool) -> Iterator[str]:
    name = f"[[{path}]]" if is_list else f"[{path}]"
    heading = f"`{name}`" if path else "At the top of the file"
    yield f"## {heading}\n"
    summary = (section.__doc__ or "").strip().splitlines()[0]
    yield f"{summary}\n"
    yield "| key | value | default | meaning |\n|---|---|---|---|"
    below: list[tuple[type[Section], str, bool]] = []
    for key, field in section.model_fields.items():
        inner = _inner(field.annotation)
        if inner is not None:
            many = get_origin(field.annotation) is tuple
            full = f"{path}.{key}" if path else key
            below.append((inner, full, many))
        value = _value(field, inner)
        meaning = (field.description or "").replace("|", "\\|")
        yield f"| `{key}` | {value} | {_default(field, inner)} | {meaning} |"
    yield ""
    for inner, full, many in below:
        yield from _section(inner, full, many)


def _inner(annotation: object) -> type[Section] | None:
    """Return the section that a key opens; poses are written in one line and open none."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return None if annotation is PoseSection else annotation
    return next((s for s in map(_inner, get_args(annotation)) if s is not None), None)


def _value(field: FieldInfo, inner: type[Section] | None) -> str:
    if inner is not None:
        return "tables, below" if get_origin(field.annotation) is tuple else "table, below"
    bounds = [f"{_SIGNS[type(m)]} {_number(m)}" for m in field.metadata if type(m) in _SIGNS]
    for m in field.metadata:
        if isinstance(m, MinLen):
            bounds.append(f"at least {m.min_length}")
        elif isinstance(m, MaxLen):
            bounds.append(f"at most {m.max_length}" + (" long" if field.annotation is str else ""))
        elif getattr(m, "pattern", None):
            bounds.append(f"`{m.pattern}`")
    return ", ".join([_type(field.annotation), *bounds])


def _number(bound: object) -> str:
    value = next(
        v for v in (getattr(bound, a, None) for a in ("ge", "gt", "le", "lt")) if v is not None
    )
    return f"{value:g}" if isinstance(value, float) else str(value)


def _type(annotation: object) -> str:
    origin, args = get_origin(annotation), get_args(annotation)
    if annotation is PoseSection:
        return "`{ xyz = […], rpy = […] }`"
    if isinstance(annotation, type) and annotation in _WORDS:
        return _WORDS[annotation]
    if origin is Literal:
        return " or ".join(f"`{a!r}`".replace("'", '"') for a in args)
    if origin is tuple:
        return f"list of {_type(args[0])}s" if args[-1] is ... else f"{len(args)} {_type(args[0])}s"
    if origin is dict:
        return f"name = {_type(args[1])}"
    if origin in (Union, types.UnionType):
        return " or ".join(_type(a) for a in args if a is not type(None))
    return _type(args[0]) if args else "value"


def _default(field: FieldInfo, inner: type[Section] | None) -> str:
    if field.is_required():
        return "**required**"
    if field.default is None:
        return "none"
    if inner is not None or field.default_factory is not None:
        return "as below" if inner is not None else "`{}`"
    value = field.default
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`[{', '.join(f'{v:g}' if isinstance(v, float) else str(v) for v in value)}]`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value}`"


if __name__ == "__main__":
    main()
