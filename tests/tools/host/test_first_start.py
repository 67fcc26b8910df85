import io
import sys

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from telerobot.drivers.rig import rig
from telerobot.server import daemon
from telerobot.server.control import compilation
from telerobot.server.control.compiled import VECTOR, compiled
from telerobot.tools.host import first_start


class Terminal(io.StringIO):
    def isatty(self):
        return True


def two_kernels():
    # Each time in a file that is new to the compiler, so that no earlier run left code on disk.
    for scale in 2.0, 3.0:
        namespace = {"__name__": __name__}
        exec(f"def scaled(x):\n    return {scale} * x[0]\n", namespace)
        yield compiled(VECTOR)(namespace["scaled"])


def compile_two():
    return [kernel(np.ones(1)) for kernel in two_kernels()]


@pytest.fixture(autouse=True)
def _forgotten():
    """Kernels of a test are nobody else's."""
    yield
    compilation.makers.pop(__name__, None)


def test_a_start_that_compiles_for_long_says_so_once(monkeypatch):
    monkeypatch.setattr(first_start, "QUIET_S", 0.0)
    to = io.StringIO()
    with first_start.told(to):
        compile_two()
    assert to.getvalue().count("compiling kernels") == 1
    assert to.getvalue().endswith("\n")


def test_on_a_terminal_a_bar_counts_kernels_and_of_how_many_where_all_are_made(monkeypatch):
    monkeypatch.setattr(first_start, "QUIET_S", 0.0)
    to = Terminal()
    with first_start.told(to):
        compile_two()
    assert "2 kernels" in to.getvalue()
    assert "/" not in to.getvalue().replace("s/ kernels", "").replace("kernels/s", "")
    assert to.getvalue().count("\n") == 1
    monkeypatch.setattr(compilation, "makers", {})
    monkeypatch.setattr(first_start, "PACKAGE", __name__)  # these are no reason to make all others
    several = [*two_kernels(), *two_kernels()]
    with first_start.told(to := Terminal()):
        compilation.make_all()
    assert f" 4/{first_start.kernels()} " in to.getvalue()
    assert not any(kernel._can_compile for kernel in several)


def test_only_who_needs_all_kernels_has_them_compiled_by_all_processors(monkeypatch):
    monkeypatch.setattr(first_start, "QUIET_S", 0.0)
    asked = []
    monkeypatch.setattr(first_start, "_compile_all", lambda: iter(asked.append("all") or ["room"]))
    news = first_start._CompileNotice(io.StringIO())
    for left in 0, 0, 9, 8:
        news(f"{first_start.PACKAGE}.room", "kernel", left)
    assert asked == ["all"]
    assert news._count == 5


def test_as_many_kernels_are_expected_as_the_package_compiles():
    assert {rig.__name__, daemon.__name__} <= sys.modules.keys()
    compilation.make_all()
    made = {
        id(thing)
        for name, module in sys.modules.items()
        if name.startswith(("telerobot.server", "telerobot.drivers"))
        for thing in vars(module).values()
        if isinstance(thing, Dispatcher) and not thing._can_compile
    }
    assert 0.9 * first_start.kernels() < len(made) <= first_start.kernels()


@pytest.mark.parametrize("to", [io.StringIO(), Terminal()])
def test_what_is_quick_or_outside_is_not_told(to):
    with first_start.told(to):
        compile_two()
    compile_two()
    assert to.getvalue() == ""


def test_kernels_are_made_when_asked_for_or_called_and_once():
    first, second = two_kernels()
    assert first._can_compile
    assert second._can_compile
    assert second(np.ones(1)) == 3.0
    assert not second._can_compile
    assert first_start._make(__name__) == (__name__, 1)
    assert not first._can_compile
    assert first_start._make(__name__) == (__name__, 0)


def test_the_command_shows_a_bar_or_a_line_for_each_to_who_reads_them(monkeypatch, capsys):
    monkeypatch.setattr(first_start, "QUIET_S", 0.0)
    monkeypatch.setattr(first_start, "_compiled", lambda: iter(["room.one", "room.other"]))
    monkeypatch.setattr(sys, "stderr", to := Terminal())
    monkeypatch.setattr(sys, "argv", ["first_start"])
    first_start._main()
    assert f" 2/{first_start.kernels()} " in to.getvalue()
    assert capsys.readouterr().out == ""
    monkeypatch.setattr(sys, "argv", ["first_start", "--lines"])
    first_start._main()
    assert capsys.readouterr().out == "room.one\nroom.other\n"


@pytest.mark.slow
def test_all_are_compiled_at_once_by_a_process_that_says_which_were_not_there():
    assert set(first_start._compile_all()) <= first_start._with_kernels().keys()
    assert list(first_start._compile_all()) == []
