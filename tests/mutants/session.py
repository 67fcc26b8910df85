"""One module's mutants in one process: the tests are collected once, then each mutant is a fork.

    python tests/mutants/session.py MODULE TEST...

The child takes the mutated code into the living module, runs the tests that come by the changed
line, the quickest first, and ends at the first that fails. Kernels of the module, and of no other,
run as plain Python, with numpy's arithmetic. One line of JSON goes out for the tests and for each
mutant.
"""

import ast
import contextlib
import functools
import importlib
import importlib.util
import json
import math
import os
import resource
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType, FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mutations import FUNCTIONS, Mutant, mutants_of

MEMORY = 2**31
"""A mutant may take so much more than the tests do [B]."""
SPARE_S = 0.5
"""And so much time beside twice what its tests take [CPU s]."""
ALIVE, KILLED, BROKEN = 0, 1, 3
"""How a child ends: all tests pass, one fails, or the laboratory itself."""

kernels: dict[str, FunctionType] = {}
"""Functions behind the module's kernels, by name."""


def _numpys() -> SimpleNamespace:
    """Return `math` as compiled code has it: no argument is an error, results are not a number."""
    names = {"acos": "arccos", "asin": "arcsin", "atan": "arctan", "atan2": "arctan2"}
    has = [name for name in dir(math) if hasattr(np, names.get(name, name)) and name[0] != "_"]
    return SimpleNamespace(**{name: getattr(np, names.get(name, name)) for name in has})


class _Numpys(ast.NodeTransformer):
    """Has kernels ask numpy what they ask `math`."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        if any(
            _name(d.func if isinstance(d, ast.Call) else d) in ("compiled", "inner_kernel")
            for d in node.decorator_list
        ):
            for inner in ast.walk(node):
                if isinstance(inner, ast.Name) and inner.id == "math":
                    inner.id = "_math"
        return node


def _name(node: ast.expr) -> str:
    return getattr(node, "id", getattr(node, "attr", ""))


def run_plain(module: str) -> None:
    """Let the kernels of a module that is to be imported be plain Python."""
    from telerobot.server.control import compiled

    def instead_of(real: Callable[[Any], Any]) -> Callable[[FunctionType], Any]:
        def decorate(function: FunctionType) -> Any:
            if function.__module__ != module:
                return real(function)
            kernels.setdefault(function.__name__, function)

            @functools.wraps(function)
            def kernel(*args: Any) -> Any:
                with np.errstate(all="ignore"):
                    return function(*args)

            return kernel

        return decorate

    real = compiled.compiled
    compiled.compiled = lambda *types: instead_of(real(*types))  # type: ignore[assignment]
    compiled.inner_kernel = instead_of(compiled.inner_kernel)  # type: ignore[assignment]


def executed(tree: ast.Module, live: ModuleType) -> dict[str, Any]:
    """Run a tree beside the living module; return what it defines."""
    made = {"__name__": live.__name__, "__package__": live.__package__, "_math": _numpys()}
    shadow = ModuleType(live.__name__)
    vars(shadow).update(made)
    code = compile(_Numpys().visit(ast.fix_missing_locations(tree)), str(live.__file__), "exec")
    sys.modules[live.__name__] = shadow  # what asks for its own module while it is being made
    try:
        exec(code, vars(shadow))
    finally:
        sys.modules[live.__name__] = live
    return vars(shadow)


def graft(live: ModuleType, fresh: dict[str, Any], scope: str, assigned: tuple[str, ...]) -> None:
    """Take the code of a scope, or what was assigned in a class or the module, into the module."""
    vars(live).setdefault("_math", _numpys())
    old, new = _found(vars(live), scope), _found(fresh, scope)
    if scope in kernels:
        _swap(kernels[scope], new.__wrapped__)
    elif scope and not isinstance(old, type):
        for mine, its in zip(_functions(old), _functions(new), strict=True):
            if len(mine.__code__.co_freevars) != len(its.__code__.co_freevars):  # no super() now
                owner, _, name = scope.rpartition(".")
                setattr(_found(vars(live), owner), name, new)
                continue
            _swap(mine, its)
    else:
        source = new if not scope else vars(new)
        for name in assigned:
            setattr(old if scope else live, name, source[name])
        for name, its in source.items() if scope else ():
            for mine, other in zip(_functions(vars(old).get(name)), _functions(its), strict=True):
                _swap(mine, other)
    clear_caches(live)


def _found(names: dict[str, Any], scope: str) -> Any:
    thing: Any = names
    for part in filter(None, scope.split(".")):
        thing = thing[part] if isinstance(thing, dict) else vars(thing)[part]
    return thing


def _functions(thing: Any) -> list[FunctionType]:
    """Return the functions behind a method, a property or what keeps results."""
    if isinstance(thing, property):
        return [f for f in (thing.fget, thing.fset) if isinstance(f, FunctionType)]
    thing = getattr(thing, "__func__", thing)
    thing = thing if isinstance(thing, FunctionType) else getattr(thing, "__wrapped__", thing)
    return [thing] if isinstance(thing, FunctionType) else []


def clear_caches(live: ModuleType) -> None:
    """Forget what the module's functions keep."""
    for thing in vars(live).values():
        if hasattr(thing, "cache_clear"):
            thing.cache_clear()


def _swap(mine: FunctionType, its: FunctionType) -> None:
    mine.__code__, mine.__defaults__ = its.__code__, its.__defaults__
    mine.__kwdefaults__ = its.__kwdefaults__


class Laboratory:
    """A plugin that runs mutants in place of the tests."""

    def __init__(self, module: str, only: str, out: Any) -> None:
        self._module, self._only, self._out = module, only, out
        self._failed: str | None = None
        self._spent: dict[str, float] = {}
        self._by_line: defaultdict[int, set[str]] = defaultdict(set)
        self._began = time.process_time()

    def _tell(self, **row: Any) -> None:
        try:
            print(json.dumps(row, ensure_ascii=False), file=self._out, flush=True)
        except BrokenPipeError:  # nobody waits for it any more
            os._exit(BROKEN)

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self, config: pytest.Config) -> None:
        config.addinivalue_line("markers", "slow: may cost more than it does compiled")
        from hypothesis import HealthCheck, Phase, settings

        settings.register_profile(
            "mutants", database=None, deadline=None, derandomize=True, max_examples=50,
            phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck),
        )  # fmt: skip
        settings.load_profile("mutants")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self._failed = f"{report.nodeid}: {report.longreprtext[-2000:]}"

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self._tell(error=str(report.longrepr))

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        try:
            self._all(session)
        except Exception as error:  # to whoever waits for lines  # noqa: BLE001
            import traceback

            self._tell(error=f"{error!r}\n{traceback.format_exc()}")
        return True

    def _all(self, session: pytest.Session) -> None:
        for item in session.items:
            item.add_marker("slow")  # plain Python may cost more than the compiled code
        live = sys.modules[self._module]
        file = Path(str(live.__file__))
        source = file.read_text()
        if kernels:
            plain = executed(ast.parse(source), live)
            vars(live)["_math"] = _numpys()
            for name, function in kernels.items():
                _swap(function, plain[name].__wrapped__)
        with self._traced(str(file)):
            for i, item in enumerate(session.items):
                clear_caches(live)  # or no other test comes by what the first one left
                began = time.process_time()
                self._run(item, session.items[(i + 1) % len(session.items)])
                self._spent[item.nodeid] = time.process_time() - began
                if self._failed:
                    self._tell(error=f"without any mutant: {self._failed}")
                    return
        if self._child_of(session, live, Mutant("", "", 0, ast.parse(source), ())) != ALIVE:
            self._tell(error="without any mutant, but in a fork, a test fails")
            return
        mutants = [m for m in mutants_of(source) if self._only in f"{m.scope} {m.change}"]
        self._tell(mutants=len(mutants), tests=len(session.items), cpu_s=self._cost())
        for mutant in mutants:
            self._try(session, live, mutant)
        self._tell(cpu_s=self._cost())

    def _cost(self) -> float:
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        return time.process_time() + children.ru_utime + children.ru_stime

    @contextlib.contextmanager
    def _traced(self, file: str) -> Iterator[None]:
        """Note which test comes by which line of the module."""

        def line(frame: FrameType, event: str, _: object) -> Any:
            if event == "line":
                self._by_line[frame.f_lineno].add(self._running)
            return line

        def call(frame: FrameType, _event: str, _: object) -> Any:
            return line(frame, "line", None) if frame.f_code.co_filename == file else None

        self._running = ""
        sys.settrace(call)
        try:
            yield
        finally:
            sys.settrace(None)

    def _run(self, item: pytest.Item, then: pytest.Item) -> None:
        self._running = item.nodeid
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=then)

    def _tests(
        self, session: pytest.Session, mutant: Mutant, live: ModuleType
    ) -> list[pytest.Item]:
        """Return the tests that come by a mutant; all where it is run at import."""
        lines = self._lines(mutant, live)
        names = set().union(*(self._by_line[line] for line in lines)) if lines else self._spent
        found = [item for item in session.items if item.nodeid in names]
        return sorted(found, key=lambda item: self._spent[item.nodeid])

    @staticmethod
    def _lines(mutant: Mutant, live: ModuleType) -> set[int]:
        """Return the lines of a mutant's statement, as its function's code has them."""
        if mutant.assigned or not mutant.scope:
            return set()
        tree = ast.parse(Path(str(live.__file__)).read_text())
        within: list[ast.stmt] = [
            node for node in ast.walk(tree)
            if isinstance(node, ast.stmt) and node.lineno <= mutant.line <= (node.end_lineno or 0)
        ]  # fmt: skip
        smallest = min(within, key=lambda node: (node.end_lineno or 0) - node.lineno)
        if isinstance(smallest, (*FUNCTIONS, ast.ClassDef)):
            return set()
        body = getattr(smallest, "body", None)
        end = body[0].lineno if isinstance(body, list) else (smallest.end_lineno or 0) + 1
        return set(range(smallest.lineno, max(end, smallest.lineno + 1)))

    def _try(self, session: pytest.Session, live: ModuleType, mutant: Mutant) -> None:
        code = self._child_of(session, live, mutant)
        if code == BROKEN:
            self._tell(error=f"{mutant.scope}: {mutant.change}")
        self._tell(scope=mutant.scope, change=mutant.change, killed=code != ALIVE,
                   by="time" if code < 0 else "")  # fmt: skip

    def _child_of(self, session: pytest.Session, live: ModuleType, mutant: Mutant) -> int:
        """Try a mutant in a fork; return how it ended."""
        tests = self._tests(session, mutant, live)
        limit_s = math.ceil(SPARE_S + 2.0 * sum(self._spent[item.nodeid] for item in tests))
        child = os.fork()
        if not child:
            self._child(session, live, mutant, tests, limit_s)
        _, status = os.waitpid(child, 0)
        return os.waitstatus_to_exitcode(status)

    def _child(self, session: pytest.Session, live: ModuleType, mutant: Mutant,
               tests: list[pytest.Item], limit_s: int) -> None:  # fmt: skip
        code = BROKEN
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 1))
            used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
            signal.alarm(60 * limit_s)  # one that waits for ever costs nothing
            try:
                fresh = executed(mutant.tree, live)
            except Exception:  # it cannot even be imported  # noqa: BLE001
                os._exit(KILLED)
            graft(live, fresh, mutant.scope, mutant.assigned)
            code = KILLED
            self._failed = None
            for item, then in zip(tests, [*tests[1:], tests[-1]] if tests else [], strict=True):
                session._setupstate.teardown_exact(item)
                self._run(item, then)
                if self._failed:
                    os._exit(KILLED)
            code = ALIVE
        finally:
            os._exit(code)


def main() -> None:
    module, only, *tests = sys.argv[1:]
    out = os.fdopen(os.dup(1), "w")
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    spec = importlib.util.find_spec(module)
    if spec and spec.origin and "@compiled(" in Path(spec.origin).read_text():
        run_plain(module)
    importlib.import_module(module)
    # Nothing is written, and no terminal told: tests are run for their verdict alone.
    code = pytest.main(
        ["-o", "addopts=", "--import-mode=importlib", "--strict-markers", "-p", "no:terminal",
         "-p", "no:cacheprovider", "-p", "no:xdist",
         *tests],
        plugins=[Laboratory(module, only, out)],
    )  # fmt: skip
    if code not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        print(json.dumps({"error": f"pytest ended with {code!r}"}), file=out, flush=True)


if __name__ == "__main__":
    main()
