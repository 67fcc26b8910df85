"""What hangs on the sensor is said anew while the arm is enabled and leans on its force source."""

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.config.schema.mechanism import GripperSection, PayloadSection
from telerobot.config.schema.rig import RigGripperSection
from telerobot.server.control.task.task import GAIN_TIME_S
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

HAND = PayloadSection(mass=0.98, com=(0.0, 0.0, 0.051))


def with_payloads(pa10, at_start):
    payloads = {"force_torque.payload": at_start, "payloads": {"hand": HAND}}
    return altered(pa10, payloads, "mechanism")


def test_a_payload_that_is_told_by_name_ends_the_drift_without_a_jump(pa10, play):
    cell = with_payloads(pa10, PayloadSection())
    run = play({"at_s": 1.0, "operator/payload": {"name": "hand"}}, cell=cell, seconds=3.0)
    before, after = run.at(0.99), run.at(2.9)
    assert before.payload[0] == 0.0
    assert after.payload == (0.98, 0.0, 0.0, 0.051)
    assert np.linalg.norm(before.wrench_mrf[:3]) > 9.0
    assert np.linalg.norm(after.wrench_mrf[:3]) < 0.5
    assert np.linalg.norm(after.sources["force"][:3]) < 1e-3
    from_tick = before.tick
    twists = np.array([s.sources["force"] for s in run.states if s.tick >= from_tick])
    noise = 6 * 0.05 * cell.config.sources.force.gain[0]
    jump = 0.1 * np.abs(twists[0][:3]).max() + noise
    assert np.abs(np.diff(twists[:, :3], axis=0)).max() < jump
    assert run.summary["limit_violations"] == 0
    assert run.events("payload_set")


def test_a_payload_that_no_one_named_is_refused_and_changes_nothing(pa10, play):
    run = play({"at_s": 0.5, "operator/payload": {"name": "anvil"}}, seconds=1.0)
    assert len(run.summary["refused"]) == 1
    assert "unknown_payload" in run.summary["refused"][0]
    assert run.states[-1].payload[0] == pa10.config.mechanism.force_torque.payload.mass


def test_the_sensors_own_reading_is_told_with_weight_and_bias_in_it(pa10, play):
    run = play(seconds=1.0)
    rig = pa10.config.rig.force_torque
    reading = np.mean([s.wrench_sensor for s in run.states[-50:]], axis=0)
    held = np.linalg.norm(reading[:3] + rig.bias[:3])
    assert abs(held - 0.98 * 9.81) < 0.1


def test_gains_that_bounce_are_refused_unless_forced(pa10, play):
    gain = {"source": "force", "gain": [5e-3] * 3 + [0.03] * 3}
    run = play({"at_s": 0.2, "operator/gain": gain}, seconds=0.5)
    assert "unstable_gain" in run.summary["refused"][0]
    run = play({"at_s": 0.2, "operator/gain": gain | {"forced": True}}, seconds=2.0)
    assert run.summary["refused"] == []
    assert run.states[-1].gains["force"][0] == pytest.approx(5e-3, rel=1e-3)
    assert run.events("gain_forced")


# --- a gripper ------------------------------------------------------------------------------------

PART = 1.0, np.array([0.02, 0.0, 0.13])
BOTH = PayloadSection(
    mass=HAND.mass + PART[0],
    com=tuple((HAND.mass * np.array(HAND.com) + PART[0] * PART[1]) / (HAND.mass + PART[0])),
)
CLOSE, OPEN = (
    {"at_s": 1.0, "operator/gripper": {"closed": True}},
    {"at_s": 3.0, "operator/gripper": {"closed": False}},
)


def with_gripper(pa10, told=True, **gripper):
    """A PA-10 whose gripper picks up 1 kg; `told`: and whose daemon knows how much that is."""
    names = {"open_payload": "hand", "closed_payload": "both"} if told else {}
    return altered(
        pa10,
        {
            "mechanism.payloads": {"hand": HAND, "both": BOTH},
            "mechanism.gripper": GripperSection(node=20, output=3, **names, **gripper),
            "rig.gripper": RigGripperSection(mass=PART[0], com=tuple(PART[1])),
        },
    )


def moved(run, a_s, b_s):
    return np.linalg.norm(np.subtract(run.at(b_s).pose_mrf[:3], run.at(a_s).pose_mrf[:3]))


@pytest.mark.parametrize("closed", [0, 1])
def test_what_is_picked_up_and_put_down_weighs_nothing_and_moves_nothing(pa10, play, closed):
    cell = with_gripper(pa10, closed=closed)
    first = {"at_s": 0.0, "operator/gripper": {"closed": False}}
    run = play(first, CLOSE, OPEN, cell=cell, seconds=5.0)
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    assert [run.at(t).gripper_closed for t in (0.9, 2.9, 4.9)] == [False, True, False]
    held = [np.linalg.norm(run.at(t).wrench_sensor[:3]) for t in (0.9, 2.9, 4.9)]
    assert held[1] - held[0] == pytest.approx(9.81 * PART[0], abs=1.0)
    assert held[2] == pytest.approx(held[0], abs=0.5)
    for settled in (0.9, 2.9, 4.9):
        assert np.linalg.norm(run.at(settled).wrench_mrf[:3]) < 0.5
    # While weight and payload change over, force control gives way a little: K_F m g τ.
    give = cell.config.sources.force.gain[0] * 9.81 * PART[0] * GAIN_TIME_S
    assert moved(run, 0.9, 2.9) < 2 * give
    assert moved(run, 2.9, 4.9) < 2 * give


def test_a_part_that_the_daemon_is_not_told_of_is_said_and_soon_moves_nothing(pa10, play):
    run = play(CLOSE, cell=with_gripper(pa10, told=False), seconds=4.0)
    assert np.linalg.norm(run.at(3.9).wrench_mrf[:3]) > 8.0
    (said,) = run.events("load_unexplained")
    assert said.values["mass_kg"] == pytest.approx(PART[0], abs=0.1)
    assert moved(run, 0.9, 2.9) < 6e-3
    assert moved(run, 2.9, 3.9) < 0.5e-3


def test_a_gripper_stays_as_it_is_until_somebody_says_otherwise(pa10, play):
    run = play(seconds=1.0, cell=with_gripper(pa10))
    assert run.states[-1].gripper_closed is None
    assert not run.simulation.rig.nodes["gripper"].closed


def test_what_is_held_is_held_on_in_a_quick_stop_and_when_the_daemon_dies(pa10, play):
    run = play(
        CLOSE,
        {"at_s": 2.0, "rig/fault": {"kind": "fault", "target": "s1"}},
        cell=with_gripper(pa10),
        seconds=3.0,
    )
    assert run.summary["mode"] == "fault"
    gripper = run.simulation.rig.nodes["gripper"]
    assert gripper.closed
    run.simulation.rig.advance(1.0)
    assert gripper.master_lost
    assert gripper.closed


def test_a_gripper_that_falls_silent_is_a_fault_that_names_it(pa10):
    cut = {"at_s": 1.5, "rig/fault": {"kind": "silence", "target": "gripper"}}
    script = Script.model_validate({"duration_s": 2.5, "step": [CLOSE | {"at_s": 0.2}, cut]})
    simulation = Simulation(with_gripper(pa10), script)
    assert simulation.run().summary["mode"] == "fault"
    faults = [e for e in simulation.events if e.name == "fault"]
    assert faults[0].values["device"] == "gripper"
    assert faults[0].values["cause"] == "heartbeat_lost"


def test_a_cell_without_a_gripper_says_so(play):
    run = play(CLOSE, seconds=1.5)
    assert "not_now" in run.summary["refused"][0]


def test_a_centre_of_mass_that_is_on_no_arm_is_refused(pa10, play):
    with pytest.raises(ValueError, match=r"com\[0\]: .* less than or equal to 2, not 71"):
        play(
            {"at_s": 1.0, "operator/payload": {"mass": 0.1, "com": [71.0, 0.0, 0.0]}},
            cell=pa10,
            seconds=2.0,
        )
