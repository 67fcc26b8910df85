"""Values of the control computation as bytes, and back, to the last bit.

Any dataclass, named tuple or enum of `server/control` is written as its name and its fields, an
array with its memory layout, since a sum may round otherwise in another one. Reading makes objects
of those classes and of no others, and runs no code of a file.
"""

import dataclasses
import enum
from collections.abc import Callable
from functools import cache
from importlib import import_module
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Final

import msgpack
import numpy as np
from numpy.lib.stride_tricks import as_strided

from ..control.stop.trajectory import PositionPlanner, Profile

CONTROL: Final = f"{__package__.rpartition('.')[0]}.control"

_PLAIN: Final = frozenset({type(None), bool, int, float, str, bytes})
_TUPLE, _LIST, _MAP, _PROXY, _STRUCT, _ENUM, _ARRAY, _SCALAR, _PROFILE = range(9)

_FLOAT: Final = np.dtype("<f8")

Lower = Callable[[Any], Any]


class RecordedValueError(ValueError):
    """Bytes that are no recorded value, or were recorded by another version."""


def pack(value: object) -> bytes:
    """Return a value as bytes. Raises `TypeError` for one that cannot be recorded."""
    packed: bytes = msgpack.packb(_lowered(value))
    return packed


class Packer:
    """Packs as `pack` does, quicker; for one thread."""

    def __init__(self) -> None:
        # Each call of `packb` takes memory for a buffer, and gives it back.
        self._pack: Callable[[Any], bytes] = msgpack.Packer().pack

    def pack(self, value: object) -> bytes:
        """Return a value as bytes. Raises `TypeError` for one that cannot be recorded."""
        return self._pack(_lowered(value))


def unpack(data: bytes) -> Any:
    """Return the value of some bytes. Raises `RecordedValueError`."""
    try:
        return _raised(msgpack.unpackb(data, use_list=False, max_ext_len=0))
    except RecordedValueError:
        raise
    except (ValueError, TypeError, KeyError, IndexError, msgpack.UnpackException) as error:
        raise RecordedValueError(f"no recorded value: {error}") from None


# --- writing -------------------------------------------------------------------------------------


def _lowered(value: Any) -> Any:
    kind: Any = type(value)
    return value if kind in _PLAIN else _lower(kind)(value)


def _array(value: "np.ndarray[Any, Any]") -> tuple[object, ...]:
    dtype, flags = value.dtype, value.flags
    if flags.c_contiguous:
        return (_ARRAY, "<f8" if dtype is _FLOAT else dtype.str, value.shape, value.tobytes())
    if flags.f_contiguous:
        return (_ARRAY, value.dtype.str, value.shape, value.tobytes("F"), "F")
    return (_ARRAY, value.dtype.str, value.shape, value.tobytes(), value.strides)


@cache
def _lower(kind: Any) -> Lower:
    """Return what takes values of a class apart. Raises `TypeError` for a foreign one."""
    special: dict[type, Lower] = {
        tuple: lambda v: (_TUPLE, *map(_lowered, v)),
        list: lambda v: (_LIST, *map(_lowered, v)),
        dict: lambda v: (_MAP, *((_lowered(k), _lowered(x)) for k, x in v.items())),
        MappingProxyType: lambda v: (_PROXY, _lowered(dict(v))),
        np.ndarray: _array,
        Profile: lambda v: (_PROFILE, *map(_lowered, (*v.plan, v.elapsed_s))),
    }
    if kind in special:
        return special[kind]
    if issubclass(kind, np.generic):
        return lambda v: (_SCALAR, v.dtype.str, v.tobytes())
    if issubclass(kind, enum.StrEnum) and not kind.__module__.startswith(CONTROL):
        return lambda v: v.value  # a name from a message: it equals its text
    name = _name_of(kind)
    if issubclass(kind, enum.Enum):
        return lambda v: (_ENUM, name, v.name)
    get, _ = fields_of(kind)
    return lambda v: (_STRUCT, name, *map(_lowered, get(v)))


def fields_of(kind: type) -> tuple[Callable[[Any], tuple[Any, ...]], int]:
    """Return what takes the fields of a value of a class, and how many there are."""
    names = _fields(kind)
    return _getter(names), len(names)


def struct_head(kind: type) -> bytes:
    """Return what stands before the fields of a value of a class, in its bytes."""
    _, count = fields_of(kind)
    packer = msgpack.Packer()
    parts: list[bytes] = [
        packer.pack_array_header(2 + count), msgpack.packb(_STRUCT), msgpack.packb(_name_of(kind))
    ]  # fmt: skip
    return b"".join(parts)


def _getter(fields: tuple[str, ...]) -> Callable[[Any], tuple[Any, ...]]:
    if len(fields) == 1:
        only = attrgetter(fields[0])
        return lambda v: (only(v),)
    return attrgetter(*fields) if fields else lambda _: ()


def _name_of(kind: type) -> str:
    module = kind.__module__
    if not module.startswith(f"{CONTROL}.") or _fields(kind) is None:
        raise TypeError(f"a {kind.__module__}.{kind.__qualname__} cannot be recorded")
    return f"{module.removeprefix(f'{CONTROL}.')}:{kind.__qualname__}"


def _fields(kind: type) -> Any:
    """Return the names of a class's fields; None for a class that has none by name."""
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind))
    if issubclass(kind, enum.Enum):
        return ()
    return getattr(kind, "_fields", None)


# --- reading -------------------------------------------------------------------------------------


def _raised(value: Any) -> Any:
    if type(value) is not tuple:
        return value
    tag, *rest = value
    match tag:
        case 0:  # _TUPLE
            return tuple(map(_raised, rest))
        case 1:  # _LIST
            return list(map(_raised, rest))
        case 2:  # _MAP
            return {_raised(k): _raised(v) for k, v in rest}
        case 3:  # _PROXY
            return MappingProxyType(_raised(rest[0]))
        case 4:  # _STRUCT
            return _struct(rest[0], [_raised(v) for v in rest[1:]])
        case 5:  # _ENUM
            return _class(rest[0])[rest[1]]
        case 6:  # _ARRAY
            return _array_of(*rest)
        case 7:  # _SCALAR
            return np.frombuffer(rest[1], np.dtype(rest[0]))[0]
        case 8:  # _PROFILE
            start, target, bounds, straight, elapsed_s = map(_raised, rest)
            planner = PositionPlanner(len(target), straight)
            return planner.plan(start, target, bounds).advanced(elapsed_s)
    raise RecordedValueError(f"no recorded value: tag {tag!r}")


def _struct(name: str, values: list[Any]) -> Any:
    kind: Any = _class(name)
    fields = _fields(kind)
    if len(fields) != len(values):
        raise RecordedValueError(
            f"{name} has {len(fields)} fields here and {len(values)} in the recording: "
            "another version of telerobot recorded it"
        )
    if dataclasses.is_dataclass(kind):
        new: Any = object.__new__
        made = new(kind)
        made.__dict__.update(zip(fields, values, strict=True))
        return made
    return kind(*values)


@cache
def _class(name: str) -> Any:
    """Return a class of the control computation by its name; no other is ever made."""
    module, _, qualname = name.partition(":")
    parts = module.split(".")
    try:
        if not all(part.isidentifier() for part in (*parts, qualname)):
            raise AttributeError
        kind = getattr(import_module(f"{CONTROL}.{module}"), qualname)
    except (ImportError, AttributeError):
        kind = None
    if not isinstance(kind, type) or kind.__module__ != f"{CONTROL}.{module}":
        raise RecordedValueError(f"{name}: no class of this version's control computation")
    if _fields(kind) is None:
        raise RecordedValueError(f"{name}: holds no fields")
    return kind


def _array_of(
    dtype: str, shape: tuple[int, ...], data: bytes, layout: str | tuple[int, ...] = "C"
) -> "np.ndarray[Any, Any]":
    flat = np.frombuffer(data, np.dtype(dtype))
    if isinstance(layout, str):
        return flat.reshape(shape, order="F" if layout == "F" else "C").copy(order="K")
    if min(layout) < 0 or flat.size == 0:
        return flat.reshape(shape).copy()
    span = sum((n - 1) * s for n, s in zip(shape, layout, strict=True)) // flat.itemsize + 1
    if span > 64 * flat.size or any(s % flat.itemsize for s in layout):
        return flat.reshape(shape).copy()
    found = as_strided(np.zeros(span, flat.dtype), shape, layout)
    found[...] = flat.reshape(shape)
    return found
