"""The judge on the bus, with drives in CST: planted violations of torque and rate are counted."""

import struct

import pytest
from telerobot.config.load import altered, load_cell
from telerobot.tools.simulation.observer import Observer

BASE = load_cell("pa10_hand")
CELL = altered(BASE, {"mechanism.operation_mode": "cst"})
DRIVE = next(d for d in CELL.config.mechanism.drives if d.joint == "e1")
T = CELL.config.timing.period_s
MILLE = DRIVE.rated_torque / 1000.0
ON, OFF = 0x0F, 0x07


def counts(angle):
    return round(DRIVE.direction * (angle - DRIVE.zero_rad) * DRIVE.counts_per_radian)


def violations(torques, angles=None, word=ON):
    """Return what is counted for torques [N·m] sent and angles [rad] told, one a period."""
    observer = Observer(CELL)
    angles = angles or [1.0] * len(torques)
    for k, (torque, angle) in enumerate(zip(torques, angles, strict=True)):
        observer.frame(k * T, 0x080, b"")
        state = struct.pack("<Hih", 0x27, counts(angle), 0)
        observer.frame(k * T + 0.001, 0x180 + DRIVE.node, state)
        raw = round(DRIVE.direction * torque / MILLE)
        observer.frame(k * T + 0.002, 0x200 + DRIVE.node, struct.pack("<Hh", word, raw))
    observer.frame(len(torques) * T, 0x080, b"")
    return [v.kind for v in observer.violations]


def ramp(last, step):
    n = round(abs(last) / step)
    return [last * i / n for i in range(n + 1)]


def test_torques_inside_their_bounds_are_no_violation() -> None:
    step = 0.99 * DRIVE.max_torque_rate * T
    up = ramp(DRIVE.max_torque, step)
    assert violations([*up, *reversed(up)]) == []


@pytest.mark.parametrize("ticks", [1, 3])
def test_a_torque_beyond_its_bound_is_counted_in_every_tick_of_it(ticks) -> None:
    up = ramp(DRIVE.max_torque, 0.5 * DRIVE.max_torque_rate * T)
    beyond = DRIVE.max_torque + 2.0 * MILLE
    assert violations([*up, *[beyond] * ticks, *reversed(up)]) == ["torque"] * ticks


def test_one_torque_off_is_two_rates() -> None:
    jump = 1.01 * DRIVE.max_torque_rate * T + 2.0 * MILLE
    assert violations([0.0, 0.0, jump, 0.0, 0.0]) == ["torque_rate"] * 2


def test_what_is_sent_while_the_drive_is_not_told_to_run_is_not_judged() -> None:
    assert violations([0.0, 1.0e3, 0.0], word=OFF) == []


def test_the_motion_is_judged_by_what_the_joint_did() -> None:
    fast = 1.2 * DRIVE.max_velocity * T
    assert violations([0.0] * 4, [1.0, 1.0 + fast, 1.0 + fast, 1.0]) == ["measured_velocity"] * 2
    upper = next(j.upper for j in CELL.robot.joints if j.name == "e1")
    assert violations([0.0] * 3, [upper + 1e-3] * 3) == ["measured_position"] * 3
