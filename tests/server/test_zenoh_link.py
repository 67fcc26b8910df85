import socket

import pytest
from telerobot.drivers.device import DeviceError
from telerobot.server.link import ZenohLink


def refusal(endpoint: str) -> str:
    with pytest.raises(DeviceError) as caught:
        ZenohLink("cell", endpoint)
    return str(caught.value)


def test_an_endpoint_that_is_taken_is_said_in_one_line():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        words = refusal(endpoint)
    assert words.startswith(f"zenoh.listen: value '{endpoint}': ")
    assert "in use" in words
    assert ".rs:" not in words
    assert "\n" not in words


def test_a_protocol_that_zenoh_does_not_know_is_said():
    assert "nosuch" in refusal("nosuch/127.0.0.1:7447")
