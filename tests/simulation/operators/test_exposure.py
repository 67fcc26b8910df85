"""A daemon that anybody may command says so, as loudly as it can."""

import pytest
from telerobot.config.load import altered
from telerobot.server.telemetry import describe
from telerobot.tools.cli import main
from telerobot.tools.host.address import moved

EVERYWHERE = "tcp/0.0.0.0:7447"


def reachable(cell, **security):
    """Return a cell whose daemon is reached from everywhere, with these words on security."""
    return altered(moved(cell, endpoint=EVERYWHERE), security, "zenoh.security")


def test_it_is_the_first_event_and_told_to_who_takes_the_lease_and_described(play, pa10):
    cell = reachable(pa10, insecure=True)
    run = play(seconds=0.2, cell=cell)
    first = run.simulation.events[0]
    (granted,) = run.events("lease_granted")
    assert [e.tick for e in run.events("insecure")] == [first.tick, granted.tick]
    assert (first.name, first.severity) == ("insecure", "warning")
    assert "anybody there may read, command and stop this arm" in first.detail
    assert first.values["endpoint"] == EVERYWHERE
    assert describe(cell).network == "insecure"


def test_of_a_daemon_of_this_machine_nothing_is_said(play, pa10):
    assert play(seconds=0.2).events("insecure") == []
    assert describe(pa10).network == "local"
    secure = moved(pa10, endpoint="tls/0.0.0.0:7447", identity="keys")
    assert describe(secure).network == "certified"


@pytest.mark.parametrize("option", [f"--endpoint={EVERYWHERE}", "--endpoint=tls/0.0.0.0:7447"])
def test_without_the_word_it_does_not_start(option, capsys):
    assert main(["serve", "pa10", option]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1
    assert "certif" in told[0]
