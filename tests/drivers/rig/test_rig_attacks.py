"""The rig outlives what it is told: absurd faults, and frames that no master sends."""

import math
import random
from collections.abc import Iterator

import can
import mujoco
import numpy as np
import pytest
from pydantic import ValidationError
from telerobot.config.load import load_cell
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.rig.rig import Rig
from telerobot.protocols.canopen import can301
from telerobot.protocols.messages.perception import RigMotion
from telerobot.protocols.messages.rig import RigFault

KINDS = (
    "silence", "fault", "stick", "block", "drop", "delay", "corrupt", "freeze", "push", "emcy",
    "cover", "move", "place", "hand",
)  # fmt: skip
NUMBERS = (
    0.0, -1.0, 0.5, 1.0, 5e-324, 1e-9, 9.9, 100.0, 5000.0, 65535.0, 1e9, -1e300, 1.7e308, math.nan,
    math.inf,
)  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "target", "value", "words"),
    [
        ("push", "e1", 1e9, "fault push: value 1e+09 N: must be at most 5000 along an axis"),
        ("hand", "force_torque", -1e300, "fault hand: value -1e+300 N: must be at most 5000"),
        ("place", "wall", 101.0, "fault place: value 101 m: must be at most 100 along an axis"),
        ("stick", "e1", 1e300, "fault stick: value 1e+300 N·m: must be 0 to 10000"),
        ("stick", "e1", -1.0, "fault stick: value -1 N·m: must be 0 to 10000"),
        ("delay", "e1", 11.0, "fault delay: value 11 s: must be 0 to 10"),
        ("drop", "e1", 1.5, "fault drop: value 1.5 of all frames: must be 0 to 1"),
        ("emcy", "e1", 65536.0, "fault emcy: value 65536 : must be 0 to 65535"),
    ],
)
def test_an_absurd_fault_is_refused_with_value_and_bound(kind, target, value, words) -> None:
    rig = Rig(load_cell("pa10"), InProcessBus(Hub()))
    with pytest.raises(ValueError) as caught:  # noqa: PT011  its words are what is tested
        rig.inject(RigFault(kind=kind, target=target, value=value, vector=(value, 0.0, 0.0)))
    assert str(caught.value).startswith(words)


def test_a_sway_that_nothing_could_follow_is_refused() -> None:
    rig = Rig(load_cell("pa10_platform"), InProcessBus(Hub()))
    with pytest.raises(
        ValueError, match=r"a sway of 1 in 0\.2 s accelerates by 987: .* at most 50"
    ):
        rig.inject(RigMotion(target="platform", sway=(1.0, 0, 0, 0, 0, 0), period_s=0.2))


def random_faults(dice: random.Random, rig: Rig) -> Iterator[RigFault | RigMotion]:
    """Yield what passes the messages' own bounds."""
    targets = (*rig.drives, "force_torque", "base", "carrier", "nobody", "floor", "wall")
    while True:
        number = lambda: dice.choice((*NUMBERS, dice.gauss(0.0, 100.0)))  # noqa: E731
        vector = (number(), number(), number())
        try:
            if dice.random() < 0.1:
                kind = dice.choice(("platform", "carrier"))
                yield RigMotion(target=kind, twist=(*vector, 0, 0, 0), sway=(0, 0, 0, *vector))
            else:
                yield RigFault(
                    kind=dice.choice(KINDS),
                    target=dice.choice(targets),
                    on=dice.random() < 0.6,
                    value=dice.choice((None, number())),
                    vector=dice.choice((None, vector)),
                )
        except ValidationError:
            continue


@pytest.mark.parametrize("name", ["pa10_platform", "ur5e_scene"])
def test_random_faults_and_frames_neither_raise_nor_break_the_physics(name, caplog) -> None:
    dice, hub = random.Random(name), Hub()
    rig, stranger = Rig(load_cell(name), InProcessBus(hub)), InProcessBus(hub)
    faults = random_faults(dice, rig)
    nodes = [d.node for d in rig.drives.values()]
    heard = (
        can301.SYNC_ID,
        can301.NMT_ID,
        can301.heartbeat_id(can301.MASTER_NODE),
        0x64,
        *map(can301.sdo_request_id, nodes),
        *map(can301.rpdo1_id, nodes),
        *map(can301.heartbeat_id, nodes),
    )
    taken = 0
    refusals: list[str] = []
    for _ in range(1500):
        try:
            rig.inject(next(faults))
            taken += 1
        except ValueError as refusal:
            refusals.append(str(refusal))
        for _ in range(6):
            can_id = dice.choice((*heard, dice.randrange(0x800)))
            data = dice.randbytes(dice.randrange(9))
            stranger.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        rig.poll()
        rig.step()
        truth = rig.truth()
        assert np.isfinite((*truth.q, *truth.dq, *truth.pose_mrf, *truth.contact_force)).all()
    assert taken > 100
    assert not any("\n" in refusal for refusal in refusals)
    for warning in (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQACC):
        assert rig.world.data.warning[warning].number == 0
    stranger.shutdown()


def test_a_download_without_end_is_given_up() -> None:
    hub = Hub()
    rig, stranger = Rig(load_cell("pa10"), InProcessBus(hub)), InProcessBus(hub)
    drive = next(iter(rig.drives.values()))
    request, reply = can301.sdo_request_id(drive.node), can301.sdo_reply_id(drive.node)

    def ask(data: bytes) -> bytes:
        stranger.send(can.Message(arbitration_id=request, data=data, is_extended_id=False))
        rig.poll()
        while (message := stranger.recv(0)) is not None:
            if message.arbitration_id == reply:
                return bytes(message.data)
        raise AssertionError("an SDO request is answered")

    assert ask(bytes((0x20, 0x65, 0x60, 0, 0, 0, 0, 0)))[0] == 0x60
    answers = [ask(bytes((0x10 * (k % 2), *range(7))))[0] for k in range(300)]
    assert answers[100] in (0x20, 0x30)
    assert answers[-1] == 0x80, "an abort"
    stranger.shutdown()
