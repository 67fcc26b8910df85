"""A force/torque sensor at an end of its range: what it reads is used by nobody."""

from pathlib import Path

import pytest
from telerobot.config.load import HERE, load_cell

PUSHED = {"kind": "push", "target": "force_torque", "vector": [0.0, 0.0, -60.0]}


@pytest.fixture
def altered(tmp_path):
    """Return a shipped cell with lines of its file changed: (before, after)."""

    def make(name, *changes):
        text = (HERE / f"cells/{name}.toml").read_text()
        for before, after in changes:
            assert before in text, f"the cell has no {before!r}"
            text = text.replace(before, after)
        path = Path(tmp_path / f"{name}.toml")
        path.write_text(text)
        return load_cell(path)

    return make


NARROW = (
    'device = "robotous"',
    'device = "robotous"\nmeasuring_range = [40.0, 40.0, 40.0, 5.0, 5.0, 5.0]',
)


NO_TOUCH = ("torque = [3.0, 2.8, 3.0, 3.0, 1.2, 1.2, 1.0]", "torque = [99, 99, 99, 99, 99, 99, 99]")


def test_force_control_fades_while_the_sensor_is_at_an_end_of_its_range(play, altered):
    run = play(
        {"at_s": 0.5, "rig/fault": PUSHED},
        {"at_s": 1.0, "rig/fault": {**PUSHED, "on": False}},
        seconds=1.5,
        cell=altered("pa10", NARROW),
    )
    told = run.events("sensor_saturated")
    assert told[0].values["axis"] == "Fx"
    assert told[0].values["range"] == 40.0
    assert not run.events("sensor_stale")
    assert run.at(0.9).wrench_mrf is None
    assert run.at(0.9).sources["force"] == (0.0,) * 6
    assert run.at(1.4).wrench_mrf is not None
    assert run.events("sensor_fresh")


def test_an_essential_sensor_at_an_end_of_its_range_stops_the_arm(play, altered):
    essential = (NARROW[0], f"{NARROW[1]}\nessential = true")
    run = play(
        {"at_s": 0.1, "for_s": 1.5, "cmd/joystick": {"twist": [0.0, 0.0, 0.05, 0.0, 0.0, 0.0]}},
        {"at_s": 0.5, "rig/fault": PUSHED},
        {"at_s": 1.0, "operator/mode": {"action": "resume"}},
        {"at_s": 1.2, "rig/fault": {**PUSHED, "on": False}},
        {"at_s": 1.8, "operator/mode": {"action": "resume"}},
        seconds=2.0,
        cell=altered("pa10", essential, NO_TOUCH),
    )
    assert run.events("sensor_saturated")[0].values["axis"] == "Fx"
    assert run.events("stopping")[0].values["reason"] == "sensor stale"
    assert run.at(0.95).mode == "hold"
    assert [r for r in run.summary["refused"] if "sensor_stale" in r]
    assert run.summary["mode"] == "enabled"


def test_arms_on_one_payload_stop_where_a_share_is_beyond_a_sensors_range(play, altered):
    """The right arm's share is 17.2 N·m, its sensor's range ends at 16.4: it would turn for ever.

    Without a sensor that is believed, the moment in truth went on to 33 N·m.
    """
    cell = altered(
        "pa10_pair",
        ("mass = 5.0", "mass = 10.4"),
        ("most_internal_moment = 15.0", "most_internal_moment = 60.0"),
        ("shares = [[1.0, 1.0, 1.0, 1.0, 1.0, 1.0]", "shares = [[3.0, 3.0, 3.0, 3.0, 3.0, 3.0]"),
    )
    run = play(
        {"at_s": 0.1, "operator/speed": {"factor": 1.0}},
        seconds=1.5,
        cell=cell,
    )
    (told,) = run.events("sensor_saturated")
    assert (told.values["mechanism"], told.values["axis"]) == ("right", "Tx")
    assert run.events("stopping")[0].values["reason"] == "sensor stale"
    moments = [abs(truth.beam.grasps[1][3]) for truth in run.truths]
    assert max(moments) < 19.0
    assert moments[-1] == pytest.approx(moments[-30], abs=0.1)
