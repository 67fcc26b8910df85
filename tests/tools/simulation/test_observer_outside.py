"""The judge on the bus, where a joint stood outside its limits when its drive was enabled."""

import struct

import pytest
from telerobot.config.load import load_cell
from telerobot.tools.simulation.observer import SAG, Observer

CELL = load_cell("pa10")
DRIVE = next(d for d in CELL.config.mechanism.drives if d.joint == "w1")
UPPER = next(j.upper for j in CELL.robot.joints if j.name == "w1")
T = CELL.config.timing.period_s
ON, OFF = 0x27, 0x23


def counts(angle):
    return round(DRIVE.direction * (angle - DRIVE.zero_rad) * DRIVE.counts_per_radian)


def violations(stood, setpoints):
    """Return what is counted for setpoints [rad], one a period, after the joint stood somewhere."""
    observer = Observer(CELL)
    for k, angle in enumerate([stood, *setpoints]):
        observer.frame(k * T, 0x080, b"")
        state = ON if k else OFF
        observer.frame(k * T, 0x180 + DRIVE.node, struct.pack("<Hih", state, counts(angle), 0))
        command = struct.pack("<Hi", 0x0F if k else 0x07, counts(angle))
        observer.frame(k * T, 0x200 + DRIVE.node, command)
    observer.frame((len(setpoints) + 1) * T, 0x080, b"")
    return [v.kind for v in observer.violations]


@pytest.mark.parametrize("beyond", [0.005, 0.03, 0.1])
def test_a_joint_that_stood_outside_may_stand_there(beyond):
    assert violations(UPPER + beyond, [UPPER + beyond] * 5) == []


def test_it_may_come_in():
    way = [UPPER + 0.03 - 2e-4 * k for k in range(200)]
    assert set(violations(UPPER + 0.03, way)) <= {"acceleration", "jerk"}  # of how it sets out


def test_it_may_not_go_further_out_than_it_stood():
    out = UPPER + 0.03 + SAG + 1e-4
    assert violations(UPPER + 0.03, [UPPER + 0.03] * 3 + [out] * 2).count("position") == 2


def test_it_may_not_go_out_again_once_it_has_come_in():
    back = [UPPER + 0.03, UPPER + 0.0297, UPPER + 0.0298, UPPER + 0.0298]
    assert violations(UPPER + 0.03, back).count("position") == 2
    inside = [UPPER - 0.001, UPPER + 0.001]
    assert violations(UPPER + 0.0012, inside).count("position") == 1
