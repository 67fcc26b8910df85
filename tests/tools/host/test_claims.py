"""Ports of this machine that nobody else is given."""

import socket
from pathlib import Path

import pytest
from telerobot.tools.host import machine
from telerobot.tools.host.machine import Claims, free_port


@pytest.fixture
def two(monkeypatch):
    """Let two ports be given away, which nobody has."""
    claims = Claims()
    first = next(n for n in range(32_100, 32_700) if not (claims.take(n) or claims.take(n + 1)))
    claims.close()
    monkeypatch.setattr(machine, "PRIVATE", range(first, first + 2))
    monkeypatch.setattr(machine, "_ours", claims)
    yield {first, first + 1}
    claims.close()


@pytest.mark.parametrize("kind", [socket.SOCK_STREAM, socket.SOCK_DGRAM])
def test_a_port_that_was_given_is_given_to_nobody_else_before_it_is_bound(two, kind):
    assert {free_port(kind), free_port(kind)} == two
    with pytest.raises(OSError, match="no port of"):
        free_port(kind)


@pytest.mark.parametrize("kind", [socket.SOCK_STREAM, socket.SOCK_DGRAM])
def test_a_port_that_somebody_has_bound_is_not_given(two, kind):
    with socket.socket(type=kind) as taken:
        taken.bind(("127.0.0.1", min(two)))
        if kind is socket.SOCK_STREAM:
            taken.listen()
        assert free_port(kind) == max(two)


def test_no_connection_is_given_one_of_them_by_the_kernel():
    least, _ = Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()
    assert int(least) >= machine.PRIVATE.stop
