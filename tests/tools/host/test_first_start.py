import io
import sys

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


def compile_two():
    # Each time in a file that is new to the compiler, so that no earlier run left code on disk.
    for scale in 2.0, 3.0:
        namespace = {"__name__": __name__}
        exec(f"def scaled(x):\n    return {scale} * x[0]\n", namespace)
        compiled(VECTOR)(namespace["scaled"])


def test_a_start_that_compiles_for_long_says_so_once(monkeypatch):
    monkeypatch.setattr(first_start, "QUIET_S", 0.0)
    to = io.StringIO()
    with first_start.told(to):
        compile_two()
    assert to.getvalue().count("compiling kernels") == 1
    assert to.getvalue().endswith("\n")


def test_on_a_terminal_a_bar_counts_every_kernel_of_those_there_are(monkeypatch):
    monkeypatch.setattr(first_start, "QUIET_S", 0.0)
    to = Terminal()
    with first_start.told(to):
        compile_two()
    assert f" 2/{first_start.kernels()} " in to.getvalue()
    assert to.getvalue().count("\n") == 1


def test_as_many_kernels_are_expected_as_the_package_compiles():
    assert {rig.__name__, daemon.__name__} <= sys.modules.keys()
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


def test_kernels_that_are_put_off_are_made_when_asked_for(monkeypatch):
    with compilation.put_off() as makers:
        compile_two()
    monkeypatch.setattr(first_start, "_made", makers)
    assert first_start._make(__name__) == (__name__, 2)


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
