import io

import pytest
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


def test_on_a_terminal_every_kernel_is_counted_in_one_line(monkeypatch):
    monkeypatch.setattr(first_start, "QUIET_S", 0.0)
    to = Terminal()
    with first_start.told(to):
        compile_two()
    assert ": 2 scaled" in to.getvalue()
    assert to.getvalue().count("\n") == 1


@pytest.mark.parametrize("to", [io.StringIO(), Terminal()])
def test_what_is_quick_or_outside_is_not_told(to):
    with first_start.told(to):
        compile_two()
    compile_two()
    assert to.getvalue() == ""
