"""A rover that meets what it was not told of: its drives feel it, it stops and lets go of it."""

from collections.abc import Callable

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.rig import BoxSection, RigBridgeSection
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

STEP = BoxSection(name="step", xyz=(0.75, 0.0, 0.125), half_size=(0.2, 0.5, 0.125))
"""A step of 0.25 m ahead."""


def rover(
    *steps: dict[str, object],
    seconds: float,
    cell: str = "rover_bridge",
    leash: float = 0.5,
    **rig: object,
) -> Simulation:
    """A run on the rover, with other things standing around than the cell has."""
    made = altered(load_cell(cell), {"bridge": None, **rig}, "rig")
    made = altered(made, {"touch.leash": leash})
    return Simulation(made, Script.model_validate({"duration_s": seconds, "step": list(steps)}))


def drive(speed: float, at_s: float = 0.3) -> dict[str, object]:
    return {"at_s": at_s, "cmd/drive": {"rates": [speed, 0.0]}}


def pressed(run: Simulation) -> list[tuple[float, float]]:
    """Return times [s], and the force of the rover on what it touches [N], as the run goes on."""
    found: list[tuple[float, float]] = []

    def look(_run: Simulation) -> None:
        found.append((run.clock.time_s, float(np.linalg.norm(run.truths[-1].contact_force))))

    run.on_tick = look
    return found


def first(run: Simulation, name: str) -> float:
    return next(event.time_s for event in run.events if event.name == name)


def odometry_off(run: Simulation) -> float:
    true, told = run.truths[-1].frames["base"], run.states[-1].frames["base"]
    return float(np.hypot(true[0] - told[0], true[1] - told[1]))


def test_a_base_that_is_driven_into_something_stops_and_lets_go_of_it() -> None:
    """The cell without a scanner: nobody looks, and the wheels' effort tells."""
    run = rover(drive(0.2), seconds=4.0, cell="rover", boxes=(STEP,))
    forces = pressed(run)
    result = run.run()
    met_s = next(time_s for time_s, force in forces if force > 0.0)
    assert first(run, "touched") < met_s + 0.1
    assert result.summary["mode"] == "hold"
    assert [force for time_s, force in forces if time_s > met_s + 1.0 and force > 1.0] == []
    assert odometry_off(run) < 0.06  # 0.3 m and more where its wheels go on
    assert result.summary["limit_violations"] == 0


def test_the_base_goes_back_quickly_as_far_as_it_came_and_slowly_beyond() -> None:
    run = rover(drive(0.4), drive(-0.3, 3.3), drive(0.0, 12.0), seconds=9.0)
    result = run.run()
    x = np.array([truth.frames["base"][0] for truth in result.truths])
    time_s = np.array([truth.time_s for truth in result.truths])
    speed = np.gradient(x, time_s)
    back = time_s > 4.4
    far = back & (x > 0.5) & (x < 1.0)
    assert x.max() > 1.0
    assert far.any()
    assert (speed[far] < -0.27).all()
    near = back & (x < 0.09)
    assert near.any()
    assert (speed[near] > -0.1).all()
    assert speed[-1] == pytest.approx(-0.05, abs=0.01)
    (told,) = [event for event in run.events if event.name == "unseen_behind"]
    assert told.values["asked"] == pytest.approx(0.3)
    assert result.summary["mode"] == "enabled"


def test_backed_into_what_nobody_saw_it_stops_gently_and_lets_go() -> None:
    """At 0.2 m/s it was 4.5 kN, and 0.7 m of odometry."""
    run = rover(drive(-0.2), seconds=8.0, bridge=RigBridgeSection(height=0.95, distance=-0.35))
    forces = pressed(run)
    run.run()
    assert run.cycle.mode == "hold"
    assert [event.name for event in run.events].count("touched") == 1
    assert forces[-1][1] < 1.0
    assert max(force for _, force in forces) < 400.0
    assert odometry_off(run) < 0.02


def test_an_axis_that_sweeps_does_not_give_way_and_uses_up_no_leash() -> None:
    run = rover(drive(-0.2), seconds=7.0, bridge=RigBridgeSection(height=0.95, distance=-0.35))
    forces = pressed(run)
    tilt = []
    look = run.on_tick

    def on_tick(run: Simulation) -> None:
        look(run)
        if run.cycle.mode == "hold":
            tilt.append(run.truths[-1].q[-1])

    run.on_tick = on_tick
    run.run()
    met_s = next(time_s for time_s, force in forces if force > 0.0)
    assert first(run, "touched") < met_s + 0.15
    assert run.cycle.mode == "hold"
    assert "still_pushed" not in [event.name for event in run.events]
    assert forces[-1][1] < 1.0
    assert max(tilt) - min(tilt) < 2e-3


def sinking(
    run: Simulation, bridge: RigBridgeSection, *, farther_m: float, speed: float = 0.1
) -> Callable[..., None]:
    """Lower the beam onto the arm, and so much farther when it touches it [m]."""
    at = [bridge.height + 0.05]
    left = [farther_m]

    def sink(_run: Simulation) -> None:
        touching = any(run.truths[-1].contact_force) or left[0] < farther_m
        if run.clock.time_s > 0.7 and left[0] > 0.0:
            at[0] -= 0.01 * speed
            left[0] -= 0.01 * speed * touching
            place = (bridge.distance + 0.1, 0.0, at[0])
            run.rig.inject(RigFault(kind="place", target="bridge_beam", vector=place))

    return sink


@pytest.mark.parametrize(
    ("farther_m", "at_m", "leash"),
    [(0.03, 0.15, 0.5), (0.1, 0.15, 0.5), (0.2, 0.15, 0.5), (0.2, 0.15, 0.1), (0.1, 0.0, 0.5)],
    ids=["a little", "far", "beyond the wrist's leash", "beyond all", "nearer to the shoulder"],
)
def test_a_beam_that_comes_down_on_the_arm_is_given_way_to_however_far(
    farther_m: float, at_m: float, leash: float
) -> None:
    """From 5 cm on a drive faulted. Beyond the leash the arm is pushed on, and stays pressed."""
    above, left = RigBridgeSection(height=1.45, distance=at_m, thickness=0.2), leash < 0.5
    run = rover(seconds=3.0 + 10.0 * farther_m, leash=leash, bridge=above)
    run.on_tick = sinking(run, above, farther_m=farther_m)
    result = run.run()
    names = [event.name for event in run.events]
    assert names.count("touched") == 1
    assert "fault" not in names
    assert ("still_pushed" if left else "gave_way") in names
    assert result.summary["mode"] == "hold"
    assert left or not any(any(truth.contact_force) for truth in result.truths[-20:])
    assert np.abs(result.truths[-1].dq).max() < 0.01
    assert result.summary["limit_violations"] == 0


def test_a_wrist_that_a_quick_beam_throws_back_is_followed_into_hold() -> None:
    """At 0.2 m/s its motor slips at its torque limit, 0.2 rad before the command comes after it."""
    above = RigBridgeSection(height=1.45, distance=0.15, thickness=0.2)
    run = rover(seconds=2.5, bridge=above)
    run.on_tick = sinking(run, above, farther_m=0.06, speed=0.2)
    result = run.run()
    names = [event.name for event in run.events]
    assert "fault" not in names
    assert "gave_way" in names
    assert result.summary["mode"] == "hold"
    assert not any(any(truth.contact_force) for truth in result.truths[-20:])
    assert max(float(np.linalg.norm(truth.contact_force)) for truth in result.truths) < 500.0


@pytest.mark.parametrize("farther_m", [0.1, 0.15])
def test_a_wrist_at_the_end_of_its_leash_stands_and_the_rest_of_the_arm_gives_way(
    farther_m: float,
) -> None:
    """Where all joints stood with it, 100 N stayed, or its drive faulted."""
    above = RigBridgeSection(height=1.45, distance=0.15, thickness=0.2)
    run = rover(seconds=3.5, bridge=above)
    run.on_tick = sinking(run, above, farther_m=farther_m, speed=0.2)
    result = run.run()
    names = [event.name for event in run.events]
    assert "fault" not in names
    assert "gave_way" in names
    assert result.summary["mode"] == "hold"
    assert not any(any(truth.contact_force) for truth in result.truths[-50:])
    held = np.array([state.q_command for state in result.states if state.mode == "hold"])
    travel = np.abs(held - held[0]).max(axis=0)
    assert travel.argmax() == 7  # j6, which goes farther where it is thrown off its command
    assert np.delete(travel, 7).max() <= run.cell.config.touch.leash
    assert result.summary["limit_violations"] == 0


def test_free_motion_of_base_and_arm_is_no_push() -> None:
    stick = {"at_s": 0.5, "cmd/joystick": {"twist": [0.05, 0.1, -0.1, 0.0, 0.3, 0.0]}}
    arc = {"at_s": 0.3, "cmd/drive": {"rates": [0.4, 0.8]}}
    back = {"at_s": 1.6, "cmd/drive": {"rates": [-0.3, -0.8]}}
    run = rover(arc, stick, back, seconds=3.0, cell="rover")
    felt, bound = [], np.array(run.cell.config.touch.torque)

    def look(_run: Simulation) -> None:
        state = run.cycle.units.each[0].perception.collisions.release
        if state.pushed is not None:
            felt.append(np.abs(state.pushed.external) - state.pushed.excused)

    run.on_tick = look
    result = run.run()
    assert result.summary["mode"] == "enabled"
    assert (np.array(felt).max(axis=0) < 0.5 * bound).all()
