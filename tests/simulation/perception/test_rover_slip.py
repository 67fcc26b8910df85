"""A rover whose wheels turn while it stays behind: its scans tell, it stops, and it knows where."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.mechanism import ImuSection
from telerobot.config.schema.rig import BoxSection
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

SIDES = (
    BoxSection(name="left", xyz=(0.0, 2.0, 1.0), half_size=(30.0, 0.1, 1.0)),
    BoxSection(name="right", xyz=(0.0, -2.0, 1.0), half_size=(30.0, 0.1, 1.0)),
)
AHEAD = BoxSection(name="ahead", xyz=(4.0, 0.0, 1.0), half_size=(0.1, 2.0, 1.0))


def on_ice(boxes: tuple[BoxSection, ...], seconds: float) -> Simulation:
    """Return a run in which the base is driven ahead at 0.3 m/s, between walls and on ice."""
    cell = altered(load_cell("rover_bridge"), {"rig.bridge": None, "rig.boxes": boxes})
    drive = {"at_s": 0.3, "cmd/drive": {"rates": [0.3, 0.0]}}
    run = Simulation(cell, Script.model_validate({"duration_s": seconds, "step": [drive]}))
    for wheel in ("wheel_left", "wheel_right"):
        run.rig.inject(RigFault(kind="slip", target=wheel, value=0.005))
    return run


def odometry_off(run: Simulation) -> float:
    true, told = run.truths[-1].frames["base"], run.states[-1].frames["base"]
    return float(np.hypot(true[0] - told[0], true[1] - told[1]))


def test_a_base_that_stays_behind_its_wheels_stops_by_name_and_its_odometry_is_put_right() -> None:
    run = on_ice((*SIDES, AHEAD), seconds=5.5)
    result = run.run()
    (slip,) = [event for event in run.events if event.name == "wheels_slip"]
    (stop,) = [event for event in run.events if event.name == "stopping"]
    assert stop.values["reason"] == "wheels slip"
    assert stop.time_s - slip.time_s < 0.05
    assert slip.values["distance_m"] < 0.15
    assert result.summary["mode"] == "hold"
    assert result.summary["limit_violations"] == 0
    assert odometry_off(run) < 0.1  # 1.3 m where nobody looks


BIAS = (0.0, 0.0, 0.06)
"""Of the gyroscope; nobody tells it [rad/s]."""


def one_wheel_on_ice(imu: ImuSection | None, wheel: str = "wheel_left") -> Simulation:
    """Return a run in which the base is driven straight ahead and one wheel has no grip."""
    drive = {"at_s": 0.8, "cmd/drive": {"rates": [0.3, 0.0]}}
    stop = {"at_s": 2.5, "silence": ["cmd/drive"]}
    cell = altered(load_cell("rover"), {"mechanism.imu": imu})
    run = Simulation(cell, Script.model_validate({"duration_s": 3.0, "step": [drive, stop]}))
    run.rig.inject(RigFault(kind="slip", target=wheel, value=0.005))
    return run


def yaw_off(run: Simulation) -> float:
    """Return how far the heading that is told is off the true one, at most [rad]."""
    times = [truth.time_s for truth in run.truths]
    true = np.unwrap([truth.frames["base"][5] for truth in run.truths])
    told = np.unwrap([state.frames["base"][5] for state in run.states])
    at = np.interp([state.time_s for state in run.states], times, true)
    return float(np.abs(told - at).max())


@pytest.mark.parametrize("wheel", ["wheel_left", "wheel_right"])
def test_a_gyroscope_sees_one_wheel_slip_at_once_and_the_heading_stays_right(wheel: str) -> None:
    gyroscope = ImuSection(node=50, T_on_imu={"rpy": (0.3, -0.5, 1.0)}, virtual={"rate_bias": BIAS})
    run = one_wheel_on_ice(gyroscope, wheel)
    assert run.run().summary["limit_violations"] == 0
    true = run.truths[-1].frames["base"][5]
    assert abs(true) > 0.8
    assert yaw_off(run) < 0.03
    (slip,) = [event for event in run.events if event.name == "wheels_slip"]
    began = next(t.time_s for t in run.truths if abs(t.frames["base"][5]) > 0.01)
    assert slip.time_s - began < 0.25
    assert "rad, at most" in slip.detail
    assert odometry_off(run) < 0.05  # 0.25 m where its accelerometer is left out


def test_without_one_the_heading_is_lost_and_nobody_is_told() -> None:
    run = one_wheel_on_ice(None)
    run.run()
    assert yaw_off(run) > 0.8
    assert not [event for event in run.events if event.name == "wheels_slip"]


def test_wheels_that_grip_are_believed_whatever_the_gyroscopes_bias() -> None:
    """A bias beyond what counts as slip is learnt before it drives, and changes nothing."""
    drive = {"at_s": 0.8, "cmd/drive": {"rates": [0.3, 0.6]}}
    told = []
    for imu in (None, ImuSection(node=50, virtual={"rate_bias": BIAS})):
        cell = altered(load_cell("rover"), {"mechanism.imu": imu})
        run = Simulation(cell, Script.model_validate({"duration_s": 3.0, "step": [drive]}))
        run.run()
        told.append(run.states[-1].frames["base"])
        assert not [event for event in run.events if event.name == "wheels_slip"]
    np.testing.assert_allclose(told[0], told[1], atol=1e-9)


UNIT = ImuSection(node=50, virtual={"rate_bias": BIAS})
STOPS = {"at_s": 1.6, "cmd/drive": {"rates": [0.0, 0.0]}}


def with_a_fault(
    fault: dict[str, object], drive: tuple[float, float], seconds: float, at_s: float = 1.0
) -> Simulation:
    """Return a run on wheels that grip, driven from 0.8 s on; the unit gets a fault at `at_s`."""
    steps = [
        {"at_s": 0.8, "cmd/drive": {"rates": drive}},
        {"at_s": at_s, "rig/fault": {"target": "imu", **fault}},
        STOPS,
    ]
    cell = altered(load_cell("rover"), {"mechanism.imu": UNIT})
    run = Simulation(cell, Script.model_validate({"duration_s": seconds, "step": steps}))
    assert run.run().summary["limit_violations"] == 0
    return run


def off_at_the_end(run: Simulation) -> float:
    """Return how far the heading that is told is off the true one at the end [rad]."""
    off = run.states[-1].frames["base"][5] - run.truths[-1].frames["base"][5]
    return abs(float(np.remainder(off + np.pi, 2.0 * np.pi) - np.pi))


@pytest.mark.parametrize(("drive", "more"), [((0.0, 0.0), 0.06), ((0.3, 0.3), -0.17)])
def test_a_bias_that_jumps_is_named_where_the_wheels_stand_and_turns_the_base_no_further(
    drive: tuple[float, float], more: float
) -> None:
    """A new bias, and one that no gyroscope has, from when on the wheels are believed."""
    run = with_a_fault({"kind": "bias", "value": more}, drive, seconds=10.0)
    (told,) = [event for event in run.events if event.name == "gyroscope_biased"]
    assert told.values["bias_rad_s"] == pytest.approx(BIAS[2] + more, abs=5e-3)
    if any(drive):  # long before, where the tool is in World counts as unknown
        slip = next(event for event in run.events if event.name == "wheels_slip")
        assert told.time_s - slip.time_s > 2.0
    assert off_at_the_end(run) < 0.02
    assert run.states[-1].mode == "enabled"


def test_what_a_unit_said_that_had_stuck_is_taken_back() -> None:
    """It sticks as the base begins to turn: for eleven samples nobody knows."""
    run = with_a_fault({"kind": "freeze"}, (0.3, 0.9), seconds=2.5, at_s=0.85)
    assert [e for e in run.events if e.name == "device_unwell"]
    assert off_at_the_end(run) < 0.003


BOTH = ("wheel_left", "wheel_right")
INERTIAL = ImuSection(node=50, virtual={"rate_bias": BIAS, "acceleration_bias": (0.1, 0.0, 0.0)})
"""Neither bias is told."""


def on_slick_floor(
    imu: ImuSection | None, friction: float, *steps: dict[str, object], seconds: float = 4.5
) -> Simulation:
    """Return a run in which neither wheel has much grip."""
    cell = altered(load_cell("rover"), {"mechanism.imu": imu})
    run = Simulation(cell, Script.model_validate({"duration_s": seconds, "step": list(steps)}))
    for wheel in BOTH:
        run.rig.inject(RigFault(kind="slip", target=wheel, value=friction))
    assert run.run().summary["limit_violations"] == 0
    return run


SPIN = ({"at_s": 0.8, "cmd/drive": {"rates": [0.3, 0.0]}}, {"at_s": 3.0, "silence": ["cmd/drive"]})


def test_an_accelerometer_sees_both_wheels_spin_on_the_spot_and_the_odometry_stays_right() -> None:
    """They turn alike: gyroscope and wheels agree. Without, 0.49 m of the way are wrong."""
    run = on_slick_floor(INERTIAL, 0.005, *SPIN)
    slip = next(event for event in run.events if event.name == "wheels_slip")
    began = next(s.time_s for s in run.states if s.q is not None and s.q[0] > 0.02)
    assert slip.time_s - began < 0.3
    assert " m and " in slip.detail
    assert odometry_off(run) < 0.06


def test_without_one_the_base_is_lost_and_nobody_is_told() -> None:
    run = on_slick_floor(None, 0.005, *SPIN)
    assert odometry_off(run) > 0.4
    assert not [event for event in run.events if event.name == "wheels_slip"]


def test_a_base_that_is_pushed_along_on_wheels_that_stand_is_followed() -> None:
    push = {"kind": "push", "target": "j1", "vector": [120.0, 0.0, 0.0]}
    steps = [{"at_s": at, "rig/fault": push | {"on": on}} for at, on in ((1.0, True), (1.5, False))]
    run = on_slick_floor(INERTIAL, 0.02, *steps, seconds=4.0)
    assert run.truths[-1].frames["base"][0] > 1.0  # the odometry's error without
    assert [event for event in run.events if event.name == "wheels_slip"]
    assert odometry_off(run) < 0.06


def test_what_the_accelerometer_told_of_a_slip_a_scanner_does_not_tell_again() -> None:
    """Both see it: the odometry is put right once."""
    cell = altered(
        load_cell("rover_bridge"),
        {"rig.bridge": None, "rig.boxes": (*SIDES, AHEAD), "mechanism.imu": INERTIAL},
    )
    drive = {"at_s": 0.8, "cmd/drive": {"rates": [0.3, 0.0]}}
    run = Simulation(cell, Script.model_validate({"duration_s": 5.5, "step": [drive]}))
    for wheel in BOTH:
        run.rig.inject(RigFault(kind="slip", target=wheel, value=0.005))
    run.run()
    assert run.states[-1].mode == "hold"
    assert odometry_off(run) < 0.1
