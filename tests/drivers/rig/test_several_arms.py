"""The rig of several arms: drives, sensors, faults and truth of each, on the bus that it names."""

import dataclasses

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.drivers.device import Cause, SwitchedOutput, WrenchSensor
from telerobot.drivers.fieldbus import VirtualBuses
from telerobot.drivers.kinds import make_drivers
from telerobot.drivers.rig.rig import Rig
from telerobot.protocols.messages.rig import RigFault
from telerobot.server.plant import Plant

PERIOD_S = 0.01
APART = (2.0, 1.0)
"""Bases, along World's y [m]."""
GRIPPER = ("", "gripper = { node = 20 }")
HELD = "[rig]\ngripper = { mass = 2.0 }\n"
LEFT, RIGHT = slice(0, 7), slice(7, 13)


class Run:
    """A rig, and the drivers of its cell, in virtual time."""

    def __init__(self, cell):
        self.cell, self.time_s = cell, 0.0
        self.buses = VirtualBuses(cell, lambda: self.time_s, self._pump)
        self.rig = Rig(cell, *self.buses.of_rig)
        self.drivers = make_drivers(cell, self.buses.of_daemon)
        self.plant = Plant(self.buses.of_daemon, self.drivers)
        self.start = np.concatenate([p.config.mechanism.postures["start"] for p in cell.parts])
        self.q = self.start.copy()

    def _pump(self, done, steps):
        for _ in range(steps):
            if done():
                return
            self.rig.poll()
            self.rig.step()
            self._tell_time()

    def _tell_time(self):
        self.time_s = self.rig.time_s
        self.buses.set_time(self.time_s)

    def cycle(self, periods=1):
        """SYNC, read, command `q`, and one period of physics; return the last reading."""
        for _ in range(periods):
            self._tell_time()
            self.plant.buses.sync()
            self.plant.buses.heartbeat()
            self.rig.poll()
            reading = self.plant.read(self.time_s)
            self.plant.write(self.q)
            self.rig.poll()
            for _ in range(round(PERIOD_S / self.rig.dt)):
                self.buses.set_time(self.rig.time_s + self.rig.dt)
                self.rig.step()
        return reading

    def enable(self):
        self.plant.open()
        self.cycle(3)
        self.plant.enable()
        reading = self.cycle(30)
        assert reading.enabled
        return reading

    def fault(self, kind, target, **more):
        self.rig.inject(RigFault(kind=kind, target=target, **more))

    def driver(self, name):
        return next(d for d in self.drivers if d.name == name)

    def wrenches(self):
        """Newest samples of both sensors."""
        return [d.read().wrench for d in self.drivers if isinstance(d, WrenchSensor)]


@pytest.fixture
def run(two_arms):
    made = Run(load_cell(two_arms(bases=APART, own=GRIPPER, more=HELD)))
    yield made
    made.buses.close()


def test_each_drive_moves_its_own_joint(run):
    assert list(run.rig.nodes) == [entry.name for entry in run.cell.devices]
    assert tuple(run.rig.drives) == run.cell.joints
    run.enable()
    step = np.zeros(13)
    step[[1, 8]] = 0.02, -0.03  # left.s2, and the second of the right arm
    for share in np.linspace(0.0, 1.0, 50):
        run.q = run.start + share * step
        reading = run.cycle()
    reading = run.cycle(50)
    assert reading.trouble is None
    np.testing.assert_allclose(reading.q - run.start, step, atol=1e-3)
    truth = run.rig.truth()
    np.testing.assert_allclose(truth.q, reading.q, atol=1e-3)
    assert set(truth.drives) == {"operation_enabled"}
    assert len(truth.drives) == len(truth.dq) == 13


def test_truth_of_each_arm_stands_under_the_name_of_its_mechanism(run):
    truth = run.rig.truth()
    assert list(truth.arms) == ["left", "right"]
    assert truth.pose_mrf == truth.arms["left"].pose_mrf
    assert truth.contact_force == truth.arms["left"].contact_force
    for i, part in enumerate(run.cell.parts):
        alone = Rig(part, *(bus for bus in run.buses.of_rig))
        assert truth.arms[part.config.mechanism.name].pose_mrf == pytest.approx(
            alone.truth().pose_mrf, abs=1e-9
        ), i
        assert alone.truth().between_arms_m is None
        assert list(alone.truth().arms) == [part.config.mechanism.name]
    assert 0.1 < truth.between_arms_m < 1.0
    run.rig.world.q[0] = -1.57  # the left arm leans over to the right one
    run.rig.world.q[1] = 1.2
    assert run.rig.truth().between_arms_m < truth.between_arms_m - 0.1


def test_a_silent_drive_is_told_by_the_name_of_its_arm(run):
    run.enable()
    run.fault("silence", "right.elbow")
    reading = run.cycle(8)
    assert (reading.trouble.device, reading.trouble.cause) == ("right.elbow", Cause.PDO_LOST)
    first = run.cell.joints.index("left.s1")
    assert run.plant.cyclic.read().troubles[first] is None


def test_a_drive_of_one_arm_breaks_down_and_the_others_stay(run):
    run.enable()
    run.fault("fault", "left.e1")
    reading = run.cycle(5)
    assert reading.trouble.device == "left.e1"
    assert reading.trouble.cause in (Cause.EMERGENCY, Cause.DRIVE_FAULT)
    states = dict(zip(run.cell.joints, run.rig.truth().drives, strict=True))
    assert states.pop("left.e1") == "fault"
    assert set(states.values()) == {"operation_enabled"}


@pytest.mark.parametrize(("bus", "silent", "heard"), [("one", LEFT, RIGHT), ("other", RIGHT, LEFT)])
def test_a_bus_that_is_unplugged_silences_the_arm_on_it_alone(run, bus, silent, heard):
    run.enable()
    run.fault("unplug", bus)
    reading = run.cycle(8)
    assert reading.trouble.cause is Cause.BUS_SILENT
    assert reading.trouble.device == f"bus {bus}"
    ages = np.array(run.plant.cyclic.read().age_syncs)
    assert (ages[silent] > 3).all()
    assert (ages[heard] <= 1).all()


def on_one_bus(cell):
    """Return the cell with the devices of both arms on the first bus, and ids that are free."""
    parts = []
    for k, part in enumerate(cell.parts):
        mechanism = part.config.mechanism
        drives = [d.model_copy(update={"node": d.node + 30 * k}) for d in mechanism.drives]
        ids = {"command_id": 0x64 + k, "reply_ids": (1 + 2 * k, 2 + 2 * k)}
        told = {"bus": "one", "drives": tuple(drives), "gripper": None}
        told["force_torque"] = mechanism.force_torque.model_copy(update=ids)
        parts.append(altered(part, {"mechanism": mechanism.model_copy(update=told)}))
    return dataclasses.replace(parts[0], others=tuple(parts[1:]))


def test_two_arms_on_one_bus_fall_silent_together_from_first_to_last(run):
    both = Run(on_one_bus(run.cell))
    both.enable()
    both.fault("unplug", "one")
    trouble = both.cycle(8).trouble
    assert trouble.cause is Cause.BUS_SILENT
    assert trouble.detail == "none of its 13 drives answers, left.s1 to right.w3"


def test_a_push_on_one_tool_is_felt_by_its_sensor_alone(run):
    run.enable()
    before = run.wrenches()
    run.fault("push", "right.force_torque", vector=(0.0, 0.0, 30.0))
    run.cycle(20)
    left, right = (
        np.linalg.norm(b[:3] - a[:3]) for a, b in zip(before, run.wrenches(), strict=True)
    )
    assert right > 25.0
    assert left < 2.0


def test_the_gripper_of_one_arm_takes_hold_with_that_arm(run):
    run.enable()
    before = run.wrenches()
    gripper = run.driver("right.gripper")
    assert isinstance(gripper, SwitchedOutput)
    gripper.write(True)
    run.cycle(40)
    left, right = (
        np.linalg.norm(b[:3] - a[:3]) for a, b in zip(before, run.wrenches(), strict=True)
    )
    assert right == pytest.approx(2.0 * 9.81, rel=0.15)
    assert left < 2.0


def test_contact_is_told_of_the_arm_that_touches(two_arms):
    box = '[[rig.boxes]]\nname = "table"\nxyz = [0.0, 1.0, -10.0]\nhalf_size = [0.2, 0.2, 0.05]\n'
    far = two_arms(bases=APART, own=GRIPPER, more=HELD + box)
    run = Run(load_cell(far))
    x, y, z, *_ = run.rig.truth().arms["right"].pose_mrf
    near = box.replace("0.0, 1.0, -10.0", f"{x}, {y}, {z - 0.055}")
    run = Run(load_cell(two_arms(bases=APART, own=GRIPPER, more=HELD + near)))
    run.rig.advance(0.01)
    truth = run.rig.truth()
    assert np.linalg.norm(truth.arms["right"].contact_force) > 1.0
    assert truth.arms["left"].contact_force == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("target", ["s1", "force_torque", "middle.s1"])
def test_a_target_that_there_is_not_is_answered_with_those_there_are(run, target):
    with pytest.raises(ValueError, match=rf"no target '{target}'; there are left\.s1, .*right\."):
        run.fault("push", target, vector=(0.0, 0.0, 1.0))
