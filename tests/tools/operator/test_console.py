"""The operator's terminal: what it shows, and that it is left as it was found."""

import os
import pty
import signal
import sys
import termios

import pytest
from telerobot.tools.operator.terminal import Console

SHOW_CURSOR = "\x1b[?25h"


@pytest.fixture
def terminal(monkeypatch):
    """Return a pseudo-terminal's end for the program; standard input comes from there."""
    master, slave = pty.openpty()
    with os.fdopen(slave) as keys:
        monkeypatch.setattr(sys, "stdin", keys)
        yield slave
    os.close(master)


@pytest.mark.usefixtures("terminal")
def test_what_is_told_after_it_was_left_draws_nothing(capsys):
    with Console() as console:
        console.show("READY", "crf 0.05 m/s")
    assert capsys.readouterr().out.endswith(SHOW_CURSOR)
    console.say("lease granted to ann")
    console.show("ENABLED")
    assert not capsys.readouterr().out


def test_settings_and_signals_are_left_as_they_were_found(terminal):
    found = termios.tcgetattr(terminal)
    handler = signal.getsignal(signal.SIGTERM)
    console = Console().__enter__()
    assert termios.tcgetattr(terminal) != found
    console.__exit__(None, None, None)
    assert termios.tcgetattr(terminal) == found
    assert signal.getsignal(signal.SIGTERM) is handler


@pytest.mark.usefixtures("terminal")
def test_a_line_stands_above_the_status(capsys):
    with Console() as console:
        console.show("READY")
        console.say("enable: done")
        assert capsys.readouterr().out.endswith("\r\x1b[Jenable: done\r\nREADY")


@pytest.mark.usefixtures("terminal")
def test_what_others_word_does_nothing_to_the_terminal(capsys):
    hostile = "asked by \x1b]0;mine\x07\x9b2J\u202eann"
    with Console() as console:
        console.show(hostile)
        shown = capsys.readouterr().out
        console.say(hostile)
        shown += capsys.readouterr().out
    assert shown.count(r"asked by \u001b]0;mine\u0007\u009b2J\u202eann") == 3
    for acts in ("\x1b]", "\x07", "\x9b", "\u202e"):
        assert acts not in shown
