"""`telerobot rig`: when it does not start."""

import random

import can
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.bus import LoopbackBus
from telerobot.drivers.device import DeviceError
from telerobot.tools.commands.rig import refuse_second


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
