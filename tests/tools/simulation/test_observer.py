"""The judge on the bus counts exactly what was planted, and equal runs have equal hashes."""

import base64
import os
import struct
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.recording.run_file import read_run
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.observer import RELATIVE, STEPS, Observer
from telerobot.tools.simulation.simulation import Simulation, simulate

CELL = load_cell("pa10")
PERIOD = CELL.config.timing.period_s
DRIVE = next(d for d in CELL.config.mechanism.drives if d.joint == "w2")
LIMIT = next(j for j in CELL.robot.joints if j.name == "w2")
BOUNDS = (DRIVE.max_velocity, DRIVE.max_acceleration, DRIVE.max_jerk)
SYNC, RPDO1 = 0x080, 0x200 + DRIVE.node
NEAR_LIMIT = 6.26
REST_S = 6.0


class Frame(NamedTuple):
    """One CAN frame of a recording."""

    time_s: float
    can_id: int
    data: bytes


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return the frames of a run that ends at rest, one joint close to its limit."""
    path = tmp_path_factory.mktemp("observer") / "run.mcap"
    posture = (*CELL.config.mechanism.postures["start"][:6], NEAR_LIMIT)
    script = Script.model_validate(
        {
            "duration_s": REST_S + 1.4,
            "step": [
                {"at_s": 0.05, "operator/switch": {"source": "force", "on": False}},
                {"at_s": 0.1, "cmd/posture": {"q": posture}},
            ],
        }
    )
    result = simulate(CELL, script, record=path)
    assert result.ok, result.summary
    assert result.summary["limit_violations"] == 0
    rows = ((m.stamp_ns / 1e9, m.json()) for m in read_run(path, ("can",)))
    return [Frame(time_s, row["id"], base64.b64decode(row["data"])) for time_s, row in rows]


def observed(frames):
    observer = Observer(CELL)
    for frame in frames:
        observer.frame(frame.time_s, frame.can_id, frame.data)
    return observer


def counted(frames):
    kinds = [v.kind for v in observed(frames).violations]
    return {kind: kinds.count(kind) for kind in sorted(set(kinds))}


def targets(frames):
    """Return the joint's target (k,) [rad] that each SYNC puts in force, from the enable on."""
    angles, pending = [], None
    for frame in frames:
        if frame.can_id == SYNC and pending is not None:
            angles.append(pending)
        elif frame.can_id == RPDO1:
            (controlword,) = struct.unpack_from("<H", frame.data)
            pending = angle(frame) if controlword & 0x0F == 0x0F else pending
    return np.array(angles)


def angle(rpdo):
    """Return the joint angle [rad] that a frame asks for."""
    (counts,) = struct.unpack_from("<i", rpdo.data, 2)
    return DRIVE.direction * counts / DRIVE.counts_per_radian + DRIVE.zero_rad


def expected(frames):
    """Count by numpy's differences, as an independent computation."""
    q = targets(frames)
    lsb = 1.0 / DRIVE.counts_per_radian
    found = {"position": int(((q < LIMIT.lower - lsb) | (q > LIMIT.upper + lsb)).sum())}
    for order, kind in enumerate(("velocity", "acceleration", "jerk"), start=1):
        difference = np.abs(np.diff(q, n=order)) / PERIOD**order
        tolerance = STEPS[order - 1] * lsb / PERIOD**order
        bound = BOUNDS[order - 1] * (1 + RELATIVE) + tolerance
        found[kind] = int((difference > bound).sum())
    return {kind: n for kind, n in sorted(found.items()) if n}


def planted(frames, offsets):
    """Return the frames with offsets [rad] added to the joint's targets from REST_S on."""
    doctored, i = [], 0
    for frame in frames:
        if frame.can_id == RPDO1 and frame.time_s >= REST_S:
            controlword, counts = struct.unpack("<Hi", frame.data)
            offset = offsets[min(i, len(offsets) - 1)]
            counts += round(DRIVE.direction * DRIVE.counts_per_radian * offset)
            doctored.append(frame._replace(data=struct.pack("<Hi", controlword, counts)))
            i += 1
        else:
            doctored.append(frame)
    assert i > len(offsets), "the recording ends before the plant does"
    return doctored


def moved(parts):
    """Return the offsets of a motion whose acceleration is these parts of the bound, by tick."""
    return np.cumsum(np.cumsum(np.array(parts) * DRIVE.max_acceleration * PERIOD)) * PERIOD


def there_and_back(parts, wait):
    return moved([*parts, *[0.0] * wait, *[-part for part in parts]])


def test_a_sound_recording_has_no_violation(recording):
    observer = observed(recording)
    assert observer.violations == []
    assert observer.syncs == sum(frame.can_id == SYNC for frame in recording)
    assert 0.3 < observer.max_speed_ratio < 1.0 + 1e-5


def test_one_setpoint_a_little_off_is_two_jerks(recording):
    # δ, −3δ, 3δ, −δ over T³: only the middle two exceed J, and 2δ/T² stays below A.
    offset = 0.4 * DRIVE.max_jerk * PERIOD**3
    frames = planted(recording, [offset, 0.0])
    assert counted(frames) == expected(frames) == {"jerk": 2}


def test_one_setpoint_farther_off_is_four_jerks_and_three_accelerations(recording):
    offset = 1.2 * DRIVE.max_acceleration * PERIOD**2
    frames = planted(recording, [offset, 0.0])
    assert counted(frames) == expected(frames) == {"acceleration": 3, "jerk": 4}


def test_acceleration_beyond_its_bound_in_two_ticks_is_counted_twice(recording):
    frames = planted(recording, moved([-0.55, -1.1, -0.55, 0.0, 0.55, 1.1, 0.55]))
    assert counted(frames) == expected(frames) == {"acceleration": 2}


def test_speed_beyond_its_bound_is_counted_in_every_tick_of_it(recording):
    ramp = [0.45, *[0.9] * 23, 0.45]
    speeds = np.cumsum(ramp) * DRIVE.max_acceleration * PERIOD
    beyond = int((speeds > DRIVE.max_velocity).sum())
    assert beyond >= 2
    # Away from the limit; falling again, all but the last of these speeds come a second time.
    frames = planted(recording, -moved([*ramp, *[-part for part in ramp]]))
    assert counted(frames) == expected(frames) == {"velocity": 2 * beyond - 1}


def test_a_target_beyond_its_limit_is_counted_in_every_tick_of_it(recording):
    rest = next(f for f in recording if f.can_id == RPDO1 and f.time_s >= REST_S)
    beyond = LIMIT.upper + 0.01 - angle(rest)
    ramp = [0.4] * 10 + [-0.4] * 10
    ramp = [part * beyond / moved(ramp)[-1] for part in ramp]
    assert max(ramp) < 0.5, "neither acceleration nor jerk is to be violated"
    frames = planted(recording, there_and_back(ramp, wait=9))
    found = counted(frames)
    assert found == expected(frames)
    assert list(found) == ["position"]
    assert 9 <= found["position"] <= 9 + len(ramp)


def test_violations_are_named_by_joint_and_bound(recording):
    offset = 0.4 * DRIVE.max_jerk * PERIOD**3
    violations = observed(planted(recording, [offset, 0.0])).violations
    assert {v.joint for v in violations} == {"w2"}
    assert {v.bound for v in violations} == {DRIVE.max_jerk}
    assert all(abs(v.value) > v.bound for v in violations)
    first, second = violations
    assert second.time_s - first.time_s == pytest.approx(PERIOD)


# --- the hash ----------------------------------------------------------------------------------

SCRIPT = {
    "duration_s": 0.8,
    "step": [
        {
            "at_s": 0.1,
            "cmd/joystick": {"twist": (0.05, 0.02, 0.0, 0.0, 0.0, 0.2), "expressed_in": "base"},
        },
        {"at_s": 0.3, "cmd/position": {"xyz": (0, 0.1, 0), "rpy": (0, 0, 0), "relative_to": "mrf"}},
    ],
}


def command_hash(document):
    return Simulation(CELL, Script.model_validate(document)).run().summary["command_hash"]


def test_equal_runs_have_equal_hashes_whatever_ran_before():
    first = command_hash(SCRIPT)
    simulate(load_cell("ur5e"), Script(duration_s=0.3))
    assert command_hash(SCRIPT) == first


def test_a_fresh_process_with_another_hash_seed_has_the_same_hash():
    code = (
        "from telerobot.tools.scripts.script import Script\n"
        "from telerobot import simulate\n"
        f"script = Script.model_validate({SCRIPT!r})\n"
        "print(simulate('pa10', script).summary['command_hash'])"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "4711"}
    ran = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert ran.stdout.strip() == command_hash(SCRIPT)


def test_one_changed_digit_of_an_input_changes_the_hash():
    twist = (0.05, 0.02, 0.0, 0.0, 0.0, 0.21)
    changed = {**SCRIPT["step"][0], "cmd/joystick": {"twist": twist, "expressed_in": "base"}}
    other = {**SCRIPT, "step": [changed, *SCRIPT["step"][1:]]}
    assert command_hash(other) != command_hash(SCRIPT)


def shifted(frames, offset):
    """Return the frames with all of the joint's targets offset [rad], from the enable on."""
    doctored = []
    for frame in frames:
        if frame.can_id == RPDO1:
            controlword, counts = struct.unpack("<Hi", frame.data)
            counts += round(DRIVE.direction * DRIVE.counts_per_radian * offset)
            frame = frame._replace(data=struct.pack("<Hi", controlword, counts))  # noqa: PLW2901
        doctored.append(frame)
    return doctored


@pytest.mark.parametrize(
    ("offset", "found"), [(-1.0, {"leap": 1}), (-0.0011, {"leap": 1}), (-0.0009, {}), (0.0, {})]
)
def test_a_leap_from_the_measured_posture_to_the_first_setpoint_counts(recording, offset, found):
    assert counted(shifted(recording, offset)) == found
