"""Loops over small arrays, compiled to machine code; and changed copies of records, quickly."""

from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

import numba
import numpy as np
from numba import types
from numba.core.caching import FunctionCache, IndexDataCacheFile

from . import compilation

# --- Loops over small arrays, compiled to machine code: what numpy's cost per call is too much for
#
# A kernel is a plain function of arrays and numbers. `@compiled(...)` states the types of its
# arguments, so that it is compiled once: an argument of another type is a TypeError. That is when
# it is called first; a daemon makes all of them before its first tick (`compilation`). Results are
# the same on every run; nothing is reassociated.
#
# Rules, which `tests/server/control/test_compiled.py` holds:
#
# - What is compiled is kept on disk beside the source, and made anew when any file changes whose
#   kernels are part of it, or a constant that it was made with, wherever that stands. One that
#   kernels alone call is an `inner_kernel`: nothing of its own is kept, nor loaded at a start.
# - Indices are checked: one out of bounds is an IndexError.
#
# Write loops over elements: a slice, a copy or an expression of whole arrays becomes ten times
# the machine code, which a tick finds cold. What a tick calls writes to arrays that its caller
# made (`ROW`, `TABLE`): an array that is returned costs more than a call.

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

NUMBER: Final = types.float64
COUNT: Final = types.int64
FLAG: Final = types.boolean
XYZ: Final = types.UniTuple(types.float64, 3)  # type: ignore[no-untyped-call]  # numba's
"""A vector (3,) from kernel to kernel: unlike an array's, its holders need not be counted."""
ATTITUDE: Final = types.UniTuple(XYZ, 3)  # type: ignore[no-untyped-call]  # numba's
"""The rows of a matrix (3, 3), likewise."""


def _array(dtype: Any, dimensions: int) -> Any:
    """Return the type of arrays that a kernel reads: of any strides, writeable or not."""
    return types.Array(dtype, dimensions, "A", readonly=True)


def record(*fields: Any) -> Any:
    """Return the type of a plain tuple of arrays and numbers: a named record goes in as `it[:]`.

    Numba takes no named tuple whose arrays may have any strides. The kernel unpacks the tuple, in
    the order that the record's class states.
    """
    return types.Tuple(fields)  # type: ignore[no-untyped-call]  # numba's


VECTOR: Final = _array(types.float64, 1)
MATRIX: Final = _array(types.float64, 2)
ARRAY3: Final = _array(types.float64, 3)
ARRAY4: Final = _array(types.float64, 4)
INDEX: Final = _array(types.int64, 1)
INDEX2: Final = _array(types.int64, 2)
ROW: Final = types.Array(types.float64, 1, "C")
"""A new vector that a kernel fills in."""
TABLE: Final = types.Array(types.float64, 2, "C")
"""Likewise a new matrix, or one that another kernel made."""
STACK: Final = types.Array(types.float64, 3, "C")
"""Likewise a new array of three dimensions."""
BLOCK: Final = types.Array(types.float64, 4, "C")
"""Likewise one of four."""
COUNTS: Final = types.Array(types.int64, 1, "C")
"""A new array of indices that a kernel fills in."""
FLAGS: Final = _array(types.boolean, 1)
FLAGS2: Final = _array(types.boolean, 2)
MARKS: Final = types.Array(types.boolean, 1, "C")
"""A new array of flags that a kernel fills in."""


_njit: Any = numba.njit
"""Its stubs know fewer options than it has."""


def _dispatcher(function: Callable[..., Any], **more: Any) -> Any:
    # No C function of it: kernels and Python call kernels, and nobody else does.
    options = {"error_model": "numpy", "boundscheck": True, "no_cfunc_wrapper": True, **more}
    return _njit(**options)(function)


def compiled(
    *arguments: Any,
) -> Callable[[Callable[Arguments, Result]], Callable[Arguments, Result]]:
    """Return a decorator that compiles a function of arguments with these types, once it is called.

    Division by zero gives inf or nan, as in numpy. Where compiled code can be written neither
    beside the source nor under the user's cache folder, it is made at every start.
    """

    def decorate(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
        made = _dispatcher(function)

        def make() -> bool:
            if not made._can_compile:
                return False
            try:
                made._cache = _Kept(function)
            except RuntimeError as error:
                if "cannot cache" not in str(error):
                    raise
            made.compile(arguments)
            made.disable_compile()
            return not made.stats.cache_hits

        _make_when_called(made, compilation.add(function, make))
        kernel: Callable[Arguments, Result] = made
        return kernel

    return decorate


def _make_when_called(kernel: Any, make: Callable[[int], bool]) -> None:
    """Let the first call of a kernel make it, be it by Python or by another that is compiled."""

    def by_python(*_arguments: Any, **_more: Any) -> Any:
        make(0)
        return kernel

    def by_kernel(arguments: Any, more: Any) -> Any:
        make(0)
        return type(kernel).get_call_template(kernel, arguments, more)

    kernel._compile_for_args, kernel.get_call_template = by_python, by_kernel


def inner_kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Mark a kernel that kernels alone call: it is compiled into each of them."""
    kernel: Callable[Arguments, Result] = _dispatcher(function)
    return kernel


class _Kept(FunctionCache):
    """Machine code on disk, for as long as all stays that it was made of.

    Numba's own looks at the file of the kernel alone, not at those of the kernels that it calls.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]  # numba's
        base, made_of = self._impl.filename_base, _made_of(function)
        self._cache_file = IndexDataCacheFile(  # type: ignore[no-untyped-call]  # numba's
            self._cache_path, base, made_of
        )


@cache
def _content(file: str) -> str:
    return sha256(Path(file).read_bytes()).hexdigest()


def _made_of(function: Callable[..., Any]) -> list[tuple[str, str]]:
    """Return what machine code of a kernel is made of: modules by content, constants by value."""
    found: dict[str, str] = {}
    seen, left = {function}, [function]
    for kernel in left:
        found[kernel.__module__] = _content(kernel.__code__.co_filename)
        for name in kernel.__code__.co_names:
            value = kernel.__globals__.get(name)
            inner = getattr(value, "py_func", None)
            if inner is not None and inner not in seen:
                seen.add(inner)
                left.append(inner)
            elif isinstance(value, int | float | str | tuple | np.ndarray):
                plain = value.tolist() if isinstance(value, np.ndarray) else value
                found[f"{kernel.__module__}.{name}"] = repr(plain)
    return sorted(found.items())


# --- A changed copy of a frozen dataclass, quickly: the tick makes a dozen of them ----------------

T = TypeVar("T")


def evolve(value: T, **changes: Any) -> T:
    """Return a copy of a dataclass with some fields changed.

    As `dataclasses.replace`, at a fifth of its cost; for dataclasses without slots and without
    `__post_init__`. Raises `TypeError` for a field that there is not, or that is not set yet.
    """
    copy = object.__new__(type(value))
    fields = copy.__dict__
    fields |= value.__dict__
    fields |= changes
    if len(fields) != len(value.__dict__):
        unknown = ", ".join(sorted(changes.keys() - value.__dict__.keys()))
        raise TypeError(f"{type(value).__name__} has no field {unknown}")
    return copy
