"""Endpoints, and who may be reached at them: what a cell file may say of the network."""

import pytest
from telerobot.config.load import ConfigError, load_cell
from telerobot.config.schema.network import ZenohSection, beyond_loopback, refuse_exposure

HERE = [
    "tcp/127.0.0.1:7447", "tcp/127.8.1.1:7447", "tcp/localhost:7447", "tcp/[::1]:7447",
    "udp/127.0.0.1:7447?rel=1", "unixsock-stream//tmp/daemon.sock",
]  # fmt: skip
BEYOND = [
    "tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/192.168.1.5:7447", "tcp/arm.local:7447",
    "udp/224.0.0.224:7446", "tcp/localhost.example:7447", "tcp/127.0.0.1.example:7447",
    "tcp/127.1:7447", "tcp/10.0.0.1:7447#iface=lo", "tcp/nothing", "tcp/:7447", "ws/0.0.0.0:80",
]  # fmt: skip


@pytest.mark.parametrize("endpoint", HERE)
def test_an_endpoint_of_this_machine_needs_no_certificate(endpoint):
    assert not beyond_loopback(endpoint)


@pytest.mark.parametrize("endpoint", BEYOND)
def test_whatever_another_machine_may_reach_is_beyond_this_one(endpoint):
    assert beyond_loopback(endpoint)


def cell_that_says(small, text):
    small.cell.write_text(small.cell.read_text() + text)
    return load_cell(small.cell)


@pytest.mark.parametrize("key", ["listen", "router"])
def test_a_daemon_that_anybody_may_reach_is_refused(small, key):
    cell = cell_that_says(small, f'[zenoh]\n{key} = "tcp/0.0.0.0:7447"\n')
    with pytest.raises(ConfigError) as caught:
        refuse_exposure(cell.config.zenoh, cell.path)
    words = str(caught.value)
    assert words.startswith(f"{small.cell}: zenoh.{key}: value 'tcp/0.0.0.0:7447': ")
    assert "telerobot certify" in words
    assert "zenoh.security.insecure = true" in words


@pytest.mark.parametrize(
    "text",
    [
        "",
        '[zenoh]\nlisten = "tls/0.0.0.0:7447"\n[zenoh.security]\ndirectory = "keys"\n',
        '[zenoh]\nlisten = "tcp/0.0.0.0:7447"\n[zenoh.security]\ninsecure = true\n',
    ],
)
def test_a_daemon_with_certificates_or_a_clear_word_is_not(small, text):
    cell = cell_that_says(small, text)
    refuse_exposure(cell.config.zenoh, cell.path)


def test_insecure_with_certificates_is_a_contradiction(small):
    with pytest.raises(ConfigError, match=r"zenoh.security: .*'insecure'"):
        cell_that_says(small, '[zenoh.security]\ndirectory = "keys"\ninsecure = true\n')


def test_who_is_on_the_daemons_machine_dials_loopback():
    assert ZenohSection(listen="tls/0.0.0.0:7447").dialled == "tls/127.0.0.1:7447"
    assert ZenohSection(listen="tls/[::]:7447").dialled == "tls/[::1]:7447"
    assert ZenohSection(listen="tls/arm:7447").dialled == "tls/arm:7447"
    assert ZenohSection(router="tls/hub:7447").dialled == "tls/hub:7447"
