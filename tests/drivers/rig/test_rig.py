"""The rig as a whole: faults on the bus, equal runs, one rig per bus, truth."""

import hashlib

import can
import numpy as np
import pytest
from telerobot.config.load import Cell, altered
from telerobot.config.schema.bus import BusSection
from telerobot.drivers.bus import Frame, Hub, InProcessBus
from telerobot.drivers.rig.rig import Rig
from telerobot.protocols.canopen import can301
from telerobot.protocols.canopen.can301 import EmcyCode
from telerobot.protocols.canopen.cia402 import DriveState
from telerobot.protocols.messages.rig import RigFault

from .conftest import PERIOD_S, Master


def digest(cell: Cell, *faults: RigFault) -> str:
    """Hash all frames of a run: enable, move one joint, with faults."""
    master = Master(cell)
    master.enable()
    for fault in faults:
        master.rig.inject(fault)
    start = master.targets["w2"]
    for k in range(40):
        master.targets["w2"] = start + 3000 * k
        master.cycle()
    master.close()
    found = hashlib.sha256()
    for stamp, can_id, data in master.frames:
        found.update(f"{stamp!r} {can_id} {data.hex()}\n".encode())
    return found.hexdigest()


def test_equal_runs_send_equal_frames_and_one_difference_shows(cell: Cell) -> None:
    faults = (
        RigFault(kind="drop", target="w1", value=0.1),
        RigFault(kind="corrupt", target="e2", value=0.05),
        RigFault(kind="delay", target="s3", value=0.003),
    )
    assert digest(cell, *faults) == digest(cell, *faults)
    rig = cell.config.rig
    assert rig is not None
    assert digest(altered(cell, {"rig.seed": 2}), *faults) != digest(cell, *faults)


def test_a_silent_node_neither_sends_nor_hears(enabled: Master) -> None:
    tpdo = can301.tpdo1_id(enabled.node("e1"))
    enabled.rig.inject(RigFault(kind="silence", target="e1"))
    before = enabled.count(tpdo)
    enabled.cycle(15)
    assert enabled.count(tpdo) == before
    assert enabled.rig.drives["e1"].state is DriveState.FAULT  # it heard no setpoints either
    enabled.rig.inject(RigFault(kind="silence", target="e1", on=False))
    enabled.cycle(2)
    assert enabled.count(tpdo) == before + 2


def test_delayed_frames_come_late_by_physics_time(enabled: Master) -> None:
    tpdo = can301.tpdo1_id(enabled.node("e1"))
    enabled.rig.inject(RigFault(kind="delay", target="e1", value=0.004))
    enabled.cycle(3)
    enabled.frames.clear()
    sync = enabled.rig.time_s
    enabled.send(can301.SYNC_ID)
    stamps = []
    for _ in range(12):
        enabled.rig.step()
        enabled.listen()
    stamps = [t for t, i, _ in enabled.frames if i == tpdo]
    # SYNC is heard 4 ms late, and answered 4 ms later; a step hands on before it moves
    assert len(stamps) == 1
    assert stamps[0] - sync == pytest.approx(0.009, abs=1.1e-3)


def test_dropped_and_corrupted_frames_are_as_many_as_asked(enabled: Master) -> None:
    tpdo = can301.tpdo1_id(enabled.node("e1"))
    enabled.rig.inject(RigFault(kind="drop", target="e1", value=0.3))
    enabled.frames.clear()
    enabled.cycle(200)
    assert 70 < enabled.count(tpdo) < 140  # SYNC heard and answer sent: 0.49 of 200


def test_an_emcy_alone_changes_nothing_else(enabled: Master) -> None:
    enabled.rig.inject(RigFault(kind="emcy", target="e1"))
    enabled.cycle(2)
    assert enabled.emergencies("e1") == [EmcyCode.OVERTEMPERATURE]
    assert enabled.state("e1") is DriveState.OPERATION_ENABLED


def test_a_sticking_joint_lags_until_the_motor_breaks_it_loose(enabled: Master) -> None:
    enabled.cycle(60)
    enabled.rig.inject(RigFault(kind="stick", target="w2", value=20.0))
    before = enabled.rig.world.q[6]
    drive = enabled.drives["w2"]
    enabled.targets["w2"] += round(0.003 * drive.counts_per_radian)
    enabled.cycle(3)
    assert abs(enabled.rig.world.q[6] - before) < 1e-3
    enabled.cycle(60)
    assert enabled.rig.world.q[6] - before == pytest.approx(0.003, abs=5e-4)


@pytest.mark.parametrize(
    "fault",
    [
        RigFault(kind="silence", target="elbow"),
        RigFault(kind="drop", target="e1", value=1.5),
        RigFault(kind="delay", target="e1"),
        RigFault(kind="push", target="e1"),
        RigFault(kind="hand", target="e1", vector=(0.0, 1.0, 0.0)),
        RigFault(kind="hand", target="force_torque"),
        RigFault(kind="hand", target="force_torque", vector=(0.0, 1.0, 0.0), value=0.0),
        RigFault(kind="freeze", target="e1"),
        RigFault(kind="block", target="force_torque"),
        RigFault(kind="stick", target="e1", value=-1.0),
        RigFault(kind="emcy", target="e1", value=1e6),
    ],
)
def test_a_fault_that_makes_no_sense_is_refused_in_one_line(
    master: Master, fault: RigFault
) -> None:
    with pytest.raises(ValueError, match=f"fault {fault.kind}: ") as caught:
        master.rig.inject(fault)
    assert "\n" not in str(caught.value)


def test_two_drives_of_one_node_id_are_an_error(cell: Cell) -> None:
    mechanism = cell.config.mechanism
    drives = (*mechanism.drives[:-1], mechanism.drives[-1].model_copy(update={"node": 1}))
    bus = InProcessBus(Hub())
    with pytest.raises(ValueError, match="same node id"):
        Rig(altered(cell, {"mechanism.drives": drives}), bus)
    bus.shutdown()


def test_truth_is_the_physics_own(enabled: Master) -> None:
    truth = enabled.rig.truth()
    assert truth.time_s == enabled.rig.time_s
    assert truth.sync_count == len(enabled.rig.sync_stamps) == round(truth.time_s / PERIOD_S)
    np.testing.assert_allclose(truth.q, enabled.rig.world.q)
    assert set(truth.drives) == {"operation_enabled"}
    assert truth.contact_force == (0.0, 0.0, 0.0)
    x, _, _, roll, pitch, yaw = truth.pose_mrf
    assert 0.6 < x < 0.7
    np.testing.assert_allclose([roll, pitch, yaw][1], np.pi / 2, atol=0.01)


def test_frames_of_several_buses_are_handled_in_the_order_they_were_sent(cell: Cell) -> None:
    named = tuple(BusSection(name=name, channel=f"239.0.0.{i}") for i, name in enumerate("ab"))
    hubs = Hub(), Hub()
    masters = [InProcessBus(hub) for hub in hubs]
    rig = Rig(altered(cell, {"buses": named}), *(InProcessBus(hub) for hub in hubs))
    for k in range(3):  # the rig comes to see three periods at once
        for i, (hub, master) in enumerate(zip(hubs, masters, strict=True)):
            hub.time_s = 0.01 * k + 1e-4 * i
            master.send(can.Message(arbitration_id=can301.SYNC_ID, is_extended_id=False))
    heard = []
    while (frame := rig.receive()) is not None:
        heard.append((frame[0].name, round(frame[1][2], 4)))
        rig.handle(*frame)
    assert heard == [(n, t) for k in range(3) for n, t in (("a", k / 100), ("b", k / 100 + 1e-4))]
    assert rig.sync_count == len(rig.sync_stamps) == 3
    for hub in hubs:
        hub.close()


class DownBus(InProcessBus):
    """A bus whose interface is down, and comes up again."""

    down = True

    def put(self, can_id: int, data: bytes) -> None:
        if self.down:
            raise can.CanOperationError("Network is down")
        super().put(can_id, data)

    def take(self, timeout: float | None = 0.0) -> list[Frame]:
        if self.down:
            raise can.CanOperationError("Network is down")
        return super().take(timeout)


def test_a_rig_lives_through_an_interface_that_is_down(cell: Cell) -> None:
    hub = Hub()
    bus, listener = DownBus(hub), InProcessBus(hub)
    rig = Rig(cell, bus)
    for _ in range(50):
        rig.step()
    assert rig.receive() is None
    bus.down = False
    listener.send(can.Message(arbitration_id=0x000, data=b"\x81\x00", is_extended_id=False))
    rig.poll()
    assert listener.recv(0) is not None, "no node boots"
    hub.close()
