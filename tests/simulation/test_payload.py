"""What hangs on the sensor is said anew while the arm is enabled and leans on its force source."""

import dataclasses

import numpy as np
from telerobot.config.schema import Payload

HAND = Payload(mass=0.98, com=(0.0, 0.0, 0.051))


def of_mechanism(cell, **update):
    mechanism = cell.config.mechanism.model_copy(update=update)
    return dataclasses.replace(cell, config=cell.config.model_copy(update={"mechanism": mechanism}))


def with_payloads(pa10, at_start):
    sensor = pa10.config.mechanism.force_torque.model_copy(update={"payload": at_start})
    return of_mechanism(pa10, force_torque=sensor, payloads={"hand": HAND})


def test_a_payload_that_is_told_by_name_ends_the_drift_without_a_jump(pa10, play):
    cell = with_payloads(pa10, Payload())
    run = play({"at_s": 1.0, "payload": {"name": "hand"}}, cell=cell, seconds=3.0)
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
    run = play({"at_s": 0.5, "payload": {"name": "anvil"}}, seconds=1.0)
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
    run = play({"at_s": 0.2, "gain": gain}, seconds=0.5)
    assert "unstable_gain" in run.summary["refused"][0]
    run = play({"at_s": 0.2, "gain": gain | {"forced": True}}, seconds=0.5)
    assert run.summary["refused"] == []
    assert run.states[-1].gains["force"][0] == 5e-3
    assert run.events("gain_forced")
