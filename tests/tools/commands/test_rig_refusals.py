"""`telerobot rig`: when it does not start, and for whom it does not wait."""

import os
import random

import can
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.bus import LoopbackBus
from telerobot.drivers.device import DeviceError
from telerobot.drivers.rig.realtime import refuse_second
from telerobot.server import process
from telerobot.tools.commands import rig


@pytest.mark.parametrize("can_id", [0x703, 0x183], ids=["heartbeat", "answer"])
def test_a_rig_does_not_start_beside_another_one_that_is_driven(can_id: int) -> None:
    dice = random.SystemRandom()
    channel, port = f"239.74.{dice.randrange(256)}.7", dice.randrange(20000, 60000)
    cell = load_cell("pa10")
    other, own = LoopbackBus(channel, port), LoopbackBus(channel, port)
    refuse_second(cell, [own])  # nobody speaks
    other.send(can.Message(arbitration_id=can_id, data=b"\x05", is_extended_id=False))
    with pytest.raises(DeviceError, match="node 3 speaks on bus: another rig"):
        refuse_second(cell, [own])
    other.shutdown()
    own.shutdown()


def test_the_virtual_hardware_does_not_wait_while_a_daemon_computes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On two cores two daemons can keep a rig that is below them from a SYNC for a whole period."""
    asked: list[int] = []
    monkeypatch.setattr(
        os, "sched_setscheduler", lambda _pid, _how, to: asked.append(to.sched_priority)
    )
    rig._prefer()
    (of_rig,) = asked
    assert of_rig > process.PRIORITY
