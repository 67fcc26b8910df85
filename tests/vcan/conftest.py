"""A kernel's CAN bus, vcan0; `make vcan` gives one to any machine."""

import subprocess
from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def vcan0():
    """Its name; skip, with the reason, where there is none."""
    if not Path("/sys/class/net/vcan0").exists():
        pytest.skip("no vcan0 here: make vcan runs these tests in user-mode Linux")
    yield "vcan0"
    put("up")


def put(state):
    subprocess.run(["ip", "link", "set", "vcan0", state], check=True)


@pytest.fixture
def interface():
    """Return what puts vcan0 up or down; needs the right to."""
    return put
