import dis
import importlib
import os
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
import telerobot.drivers.rig as rig
import telerobot.server as server
import telerobot.server.control as control
from telerobot.server.control import compilation
from telerobot.server.control.compiled import COUNT, MATRIX, TABLE, VECTOR, compiled
from telerobot.server.control.spatial import rotation_exp, rotation_log


@compiled(MATRIX, VECTOR)
def product(A, x):
    y = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            y[i] += A[i, j] * x[j]
    return y


@compiled(VECTOR, COUNT)
def entry(x, i):
    return x[i]


def kernels() -> Iterator[tuple[str, Any]]:
    for room in (control, rig):
        for found in pkgutil.walk_packages(room.__path__, room.__name__ + "."):
            module = importlib.import_module(found.name)
            for name, thing in vars(module).items():
                if hasattr(thing, "py_func") and thing.py_func.__module__ == module.__name__:
                    yield f"{module.__name__}.{name}", thing


def test_a_kernel_reads_arrays_of_any_strides_and_those_that_may_not_be_written():
    A, x = np.arange(6.0).reshape(3, 2), np.ones(3)
    x.flags.writeable = False
    np.testing.assert_array_equal(product(A.T, x), A.T @ x)


def test_an_argument_of_another_type_is_refused_and_compiles_nothing():
    with pytest.raises(TypeError):
        product(np.ones((2, 2), dtype=np.int64), np.ones(2))
    assert len(product.signatures) == 1


def test_a_kernel_that_is_first_called_by_another_is_made_for_its_own_types():
    # In no file, so that no earlier run left code on disk.
    there = {"__name__": __name__}
    exec("def first(x): return x[0]\ndef corner(A): return first(A[0])\n", there)
    there["first"] = first = compiled(VECTOR)(there["first"])
    corner = compiled(TABLE)(there["corner"])
    assert first._can_compile
    assert corner(np.array([[3.0, 4.0]])) == 3.0
    assert not first._can_compile
    assert first.signatures == [(VECTOR,)]
    assert first(np.arange(1.0, 9.0)[::2]) == 1.0


def test_a_first_call_with_another_type_is_refused_too():
    with pytest.raises(TypeError):
        last_of("ab")
    assert last_of(np.array([1.0, 2.0])) == 2.0


@compiled(VECTOR)
def last_of(x):
    return x[-1]


def test_an_index_out_of_bounds_is_an_error():
    with pytest.raises(IndexError):
        entry(np.ones(3), 3)


def test_a_division_by_zero_is_as_in_numpy():
    assert np.isinf(quotient(np.array([1.0, 0.0])))


@compiled(VECTOR)
def quotient(x):
    return x[0] / x[1]


KEPT = {
    "lengths.py": """
from telerobot.server.control.compiled import inner_kernel

FACTOR = 2.0

@inner_kernel
def first(x):
    return x[0]
""",
    "between.py": """
from lengths import first
from telerobot.server.control.compiled import inner_kernel

@inner_kernel
def twice(x):
    return 2.0 * first(x)
""",
    "outer.py": """
import numpy as np
from between import twice
from lengths import FACTOR
from telerobot.server.control import compilation
from telerobot.server.control.compiled import VECTOR, compiled

compilation.listeners.append(lambda module, name, left: print(name))

@compiled(VECTOR)
def outer(x):
    return FACTOR * twice(x)

print(outer(np.array([1.0, 10.0])))
""",
}


def test_kept_code_is_made_anew_when_a_kernel_it_calls_or_a_constant_of_another_file_changes(
    tmp_path,
):
    for name, text in KEPT.items():
        (tmp_path / name).write_text(text)

    def told():
        path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
        run = subprocess.run(
            [sys.executable, "-B", "outer.py"], cwd=tmp_path, capture_output=True, text=True,
            check=True, env=os.environ | {"PYTHONPATH": path},
        )  # fmt: skip
        return run.stdout.split()

    assert told() == ["outer", "4.0"]
    assert told() == ["4.0"], "what is kept is not used"
    (tmp_path / "lengths.py").write_text(KEPT["lengths.py"].replace("x[0]", "x[1]"))
    assert told() == ["outer", "40.0"], "a kernel two files away has changed"
    assert told() == ["40.0"]
    (tmp_path / "third.py").write_text("FACTOR = 2.0")
    outer = KEPT["outer.py"].replace("from lengths import", "from third import")
    (tmp_path / "outer.py").write_text(outer)
    assert told() == ["outer", "40.0"]
    (tmp_path / "third.py").write_text("FACTOR = 3.0")
    assert told() == ["outer", "60.0"], "a constant of a file without kernels has changed"


def test_every_kernel_is_compiled_for_stated_types_once_or_into_those_that_call_it():
    """One that Python calls, too, would be compiled at the first call, in the middle of a tick."""
    called = {id(thing) for _, kernel in kernels() for thing in globals_of(kernel)}
    compilation.make_all()
    for name, kernel in kernels():
        if not kernel._can_compile:
            assert len(kernel.signatures) == 1, name
            continue
        assert id(kernel) in called, f"{name}: no kernel calls it"
        for where, users in python_users():
            assert id(kernel) not in users, f"{name}: {where} calls it"


@cache
def python_users():
    """Return what is no kernel, by name, and what the names in it are."""
    found = []
    for room in (server, rig):
        for module in pkgutil.walk_packages(room.__path__, room.__name__ + "."):
            importlib.import_module(module.name)
    for module_name, module in list(sys.modules.items()):
        if not module_name.startswith("telerobot."):
            continue
        for holder in (module, *[x for x in vars(module).values() if isinstance(x, type)]):
            for name, thing in vars(holder).items():
                code = getattr(getattr(thing, "__func__", thing), "__code__", None)
                if hasattr(thing, "py_func") or getattr(thing, "__module__", "") != module_name:
                    continue
                if code is not None:
                    at, every = getattr(module, "__dict__", {}), (code, *nested(code))
                    names = {n for c in every for n in c.co_names if hasattr(at.get(n), "py_func")}
                    loaded = {n for c in every for n in global_names(c)} if names else set()
                    used = frozenset(id(at[n]) for n in names & loaded)
                    found.append((f"{module_name}.{name}", used))
    return found


def global_names(code):
    """Return the global names in code, and not those of attributes, as of `np.cross`."""
    return {i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL"}


def nested(code):
    """Return the code inside of code, as of lambdas."""
    inside = [c for c in code.co_consts if hasattr(c, "co_names")]
    return [*inside, *(deeper for c in inside for deeper in nested(c))]


def globals_of(kernel):
    function = kernel.py_func
    return [function.__globals__.get(name) for name in function.__code__.co_names]


def test_rotations_are_compiled_before_a_tick_calls_them():
    """A kernel that is made when it is first called stops the tick for a third of a second."""
    for kernel, argument in ((rotation_log, np.eye(3)), (rotation_exp, np.zeros(3))):
        ready = list(kernel.signatures)
        assert ready
        kernel(argument)
        kernel(np.asfortranarray(np.eye(3, 4)[:, :3]) if argument.ndim == 2 else np.zeros(6)[::2])
        assert kernel.signatures == ready
