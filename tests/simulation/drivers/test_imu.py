"""An inertial measurement unit on a rover, through the whole line."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.mechanism import ImuSection
from telerobot.tools.checks.cell import bus_load

BIAS = (0.0, 0.0, 0.03)
TURN = {"at_s": 0.3, "cmd/drive": {"rates": [0.3, 0.5]}}
SILENT = {"kind": "silence", "target": "imu"}


@pytest.fixture(scope="module")
def measured():
    """A rover with a unit 0.2 m ahead of its axle, whose bias is told."""
    imu = ImuSection(
        node=50,
        T_on_imu={"xyz": (0.2, 0.0, 0.1), "rpy": (0.0, 0.0, np.pi / 2)},
        rate_bias=BIAS,
        virtual={"rate_bias": BIAS},
    )
    return altered(load_cell("rover"), {"mechanism.imu": imu})


def test_it_tells_how_the_base_turns_and_what_it_feels(play, measured):
    run = play(TURN, seconds=2.5, cell=measured)
    late = [s.devices["imu"] for s in run.states[-60:]]
    mean = {key: np.mean([values[key] for values in late]) for key in late[0] if key != "trouble"}
    frames = [t.frames["base"][5] for t in run.truths[-60:]]
    true = (frames[-1] - frames[0]) / (run.truths[-1].time_s - run.truths[-60].time_s)
    assert mean["wz"] == pytest.approx(true, abs=2e-3)
    # Its x is to the left, where the middle of the turn is: v ω, and ω² from the axle.
    assert mean["ax"] == pytest.approx(0.3 * 0.5, abs=0.03)
    assert mean["ay"] == pytest.approx(0.2 * 0.5**2, abs=0.03)
    assert mean["az"] == pytest.approx(9.81, abs=0.03)


def test_one_that_falls_silent_is_told_of_stops_nothing_and_comes_back(play, measured):
    run = play(
        TURN,
        {"at_s": 0.8, "rig/fault": SILENT},
        {"at_s": 1.4, "rig/fault": SILENT | {"on": False}},
        seconds=3.2,
        cell=measured,
    )
    assert run.summary["failure"] is None
    assert run.at(3.1).mode == "enabled"
    unwell = run.events("device_unwell")
    assert unwell[0].detail == "imu: no sample for 4 SYNCs"
    assert [e.values["cause"] for e in unwell[:2]] == ["pdo_lost", "heartbeat_lost"]
    assert len(run.events("device_well")) == 1
    assert run.at(1.2).devices["imu"]["wz"] is None
    assert run.at(1.2).devices["imu"]["trouble"] == "heartbeat_lost"
    assert run.at(3.1).devices["imu"]["wz"] == pytest.approx(0.5, abs=0.02)


def test_check_says_what_it_measures_and_counts_its_frames(measured):
    found = {finding.check: finding for finding in bus_load(measured)}
    assert found["imu"].text == (
        "on Base, ±78 m/s² in steps of 0.0024, ±4.36 rad/s in steps of 0.00015, every SYNC"
    )
    without = {finding.check: finding for finding in bus_load(load_cell("rover"))}
    more = found["bus load"].values["cyclic"] - without["bus load"].values["cyclic"]
    assert 0.01 < more < 0.03
