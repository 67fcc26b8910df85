"""A script on a running daemon, in the time of a clock of the test."""

from types import SimpleNamespace

import pytest
from telerobot.tools.scripts import live_run
from telerobot.tools.scripts.live_run import ENABLE_WITHIN_S, LiveRun
from telerobot.tools.scripts.script import Script


@pytest.fixture
def live(daemon, make_state, monkeypatch):
    """Return a function that plays a script of so many seconds on the daemon of the tests."""
    clock = SimpleNamespace(now_s=100.0)
    clock.monotonic = lambda: clock.now_s
    clock.sleep = lambda seconds: setattr(clock, "now_s", clock.now_s + max(seconds, 0.01))
    monkeypatch.setattr(live_run, "time", clock)
    operator = SimpleNamespace(
        cell="cell", session=daemon, inject=lambda _fault: None, reflection=None, state=None
    )

    def turn():
        operator.state_since_s = clock.now_s
        operator.state = make_state(tick=round(clock.now_s * 100), mode=daemon.mode)
        operator.on_state(operator.state)

    operator.turn = turn

    def play(seconds):
        run = LiveRun(operator, Script(duration_s=seconds), lambda _line: None)
        run.play()
        return run

    return play


def test_a_script_that_takes_longer_than_enabling_may_is_played_to_its_end(live):
    run = live(ENABLE_WITHIN_S + 5.0)
    assert run.player.over
    assert run.failure == ""


def test_an_arm_that_is_not_enabled_in_time_is_told(live, daemon):
    daemon.ask = lambda *_request: None
    assert live(1.0).failure == "the arm was not enabled; mode is ready"
