"""python-can's own tools on the loopback bus, by the entry point of this package."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import can
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.bus import LoopbackBus
from telerobot.drivers.can_plugin import LoopbackInterface
from telerobot.tools.host.local_plant import private

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def bus():
    config = private(load_cell("pa10")).config.bus
    bus = LoopbackBus(config.channel, config.port)
    yield f"{config.channel}:{config.port}", bus
    bus.shutdown()


@pytest.fixture
def installed(tmp_path):
    """The environment of a process that sees this package's entry points, installed or not."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    folder = tmp_path / "telerobot_plugin-0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: telerobot-plugin\nVersion: 0\n")
    (folder / "entry_points.txt").write_text(
        "\n".join(
            f"[{group}]\n" + "\n".join(f"{name} = {to}" for name, to in points.items())
            for group, points in project["entry-points"].items()
        )
    )
    return {**os.environ, "PYTHONPATH": f"{ROOT / '.namespace'}:{tmp_path}"}


def test_can_logger_sees_the_frames_of_a_loopback_bus(bus, installed):
    channel, sender = bus
    command = [sys.executable, "-u", "-m", "can.logger", "-i", "telerobot_loopback", "-c", channel]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=installed) as logger:
        try:
            while "Connected" not in (line := logger.stdout.readline()):
                assert line, "can_logger ended"
            frame = can.Message(arbitration_id=0x1A5, data=b"\x01\x02", is_extended_id=False)
            sender.send(frame)
            while "1a5" not in (line := logger.stdout.readline()).lower():
                assert line, "can_logger ended"
            assert "01 02" in line
        finally:
            logger.terminate()


def test_filters_are_python_cans(bus):
    channel, sender = bus
    only = [{"can_id": 0x80, "can_mask": 0x7FF}]
    with LoopbackInterface(channel, can_filters=only) as heard:
        for can_id in (0x181, 0x80):
            sender.send(can.Message(arbitration_id=can_id, is_extended_id=False))
        assert heard.recv(5.0).arbitration_id == 0x80


@pytest.mark.parametrize("channel", ["239.74.163.10:many", "10.0.0.1"])
def test_a_channel_that_is_none_is_refused(channel):
    with pytest.raises(can.CanInitializationError, match=channel.partition(":")[0]):
        LoopbackInterface(channel)
