"""A push that the force/torque sensor does not see stops the arm; ordinary motion does not."""

import numpy as np
import pytest
from laboratory.campaign.contact import sliding, touch
from laboratory.campaign.contact.sliding import Slide
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

MOVING = {
    "at_s": 0.3,
    "cmd/joystick": {"twist": [0.0, 0.05, 0.02, 0.0, 0.0, 0.1], "expressed_in": "base"},
}


@pytest.mark.parametrize("number", [1, 2, 4, 5, 9])
def test_a_push_at_the_elbow_is_felt_from_every_side(number):
    run = touch.play(("push", number))
    assert run.reasons == []


@pytest.mark.parametrize("seed", [3, 11])
def test_half_a_minute_of_free_motion_with_a_heavy_tool_is_no_push(seed):
    run = touch.play(("free", seed))
    assert run.reasons == []
    assert run.moving_s > 20.0


SLIDES = [
    Slide("wall", 10.0, 0.05, 4),
    Slide("wall", 60.0, 0.1, 7),
    Slide("table", 10.0, 0.1, 1),
    Slide("table", 60.0, 0.05, 6),
]


@pytest.mark.parametrize("slide", SLIDES, ids=str)
def test_a_tool_that_slides_along_what_it_presses_is_not_pushed(slide):
    run = touch.play(("slide", sliding.SLIDES.index(slide)))
    assert run.reasons == []


def test_the_event_names_joint_estimate_and_bound_and_the_way_out_is_resume(play):
    run = play(
        MOVING,
        {"at_s": 2.0, "rig/fault": {"kind": "push", "target": "e1", "vector": [-30.0, 0.0, 0.0]}},
        {"at_s": 3.0, "operator/mode": {"action": "resume"}},
        {"at_s": 4.0, "rig/fault": {"kind": "push", "target": "e1", "on": False}},
        {"at_s": 5.0, "operator/mode": {"action": "resume"}},
        {"at_s": 5.2, "cmd/joystick": MOVING["cmd/joystick"]},
        seconds=6.5,
    )
    (felt,) = run.events("touched")
    assert felt.values["joint"] == "s2"
    assert abs(felt.values["torque_nm"]) > felt.values["bound_nm"]
    assert run.at(3.5).mode == "hold"
    assert len(run.summary["refused"]) == 1
    assert run.at(6.4).mode == "enabled"
    assert run.summary["limit_violations"] == 0


def test_pressing_a_wall_with_the_tool_is_seen_and_no_push(play):
    run = play(
        {"at_s": 0.3, "cmd/joystick": {"twist": [0.03, 0, 0, 0, 0, 0], "expressed_in": "base"}},
        seconds=12.0,
    )
    assert max(abs(f) for f in run.states[-1].wrench_mrf[:3]) > 5.0
    assert run.events("touched") == []


def test_an_arm_that_a_stick_drives_into_a_table_stops_lets_go_and_never_faults(play):
    """A link beside the tool meets it; s2 stops dead at 0.9 rad/s, and its command does not."""
    stick = {"twist": [0.0, 0.0, -0.4, 0.0, 0.0, 0.0], "expressed_in": "base"}
    run = play({"at_s": 0.1, "cmd/joystick": stick}, seconds=2.2)
    (felt,) = run.events("touched")
    assert felt.values["joint"] == "s2"
    assert run.events("fault") == []
    assert run.summary["mode"] == "hold"
    assert not any(any(truth.contact_force) for truth in run.truths[-20:])
    assert run.summary["limit_violations"] == 0


def test_an_arm_that_cannot_feel_says_so_and_that_it_can_again(pa10):
    """Two SYNCs of known instants in a row are too few: an acceleration takes three."""
    script = Script.model_validate({"duration_s": 5.0, "step": [MOVING]})
    simulation = Simulation(pa10, script)
    fieldbus = simulation.cycle.plant.buses[0]
    sync = fieldbus.sync

    def late_now_and_then():
        sync()
        if fieldbus.sync_count % 3 == 0 and 2.0 < simulation.clock.now() < 4.0:
            fieldbus.sync_s = None

    fieldbus.sync = late_now_and_then
    run = Run(simulation, simulation.run())
    (lost,), (found,) = run.events("touch_lost"), run.events("touch_found")
    assert 2.5 <= lost.time_s < 2.6
    assert 4.0 <= found.time_s < 4.1
    assert run.events("touched") == []
    assert run.states[-1].mode == "enabled"


# A turn about the sensor's own axis, axes that point the other way, and a mounting out by 30°.
@pytest.mark.parametrize("rpy", [(0.0, 0.0, np.pi), (np.pi, 0.0, 0.0), (0.0, 0.0, np.pi / 6)])
@pytest.mark.parametrize("v", [(0.05, 0.0, 0.0), (0.05, 0.05, 0.0)])
def test_a_sensor_that_is_mounted_otherwise_than_told_lets_nobody_press(play, pa10, rpy, v):
    """Force control answers a contact to the wrong side then: the joints feel what it does."""
    run = play(
        {"at_s": 0.0, "cmd/posture": {"posture": "ready"}},
        {"at_s": 2.6, "cmd/joystick": {"twist": [*v, 0.0, 0.0, 0.0], "expressed_in": "base"}},
        seconds=6.5,
        cell=altered(pa10, {"rig.force_torque.mounting_rpy": rpy}),
    )
    assert run.summary["mode"] == "hold"
    assert run.events("touched")
    force = [float(np.linalg.norm(truth.contact_force)) for truth in run.truths]
    assert max(force) < 150.0
    assert max(force[-50:]) < 5.0


@pytest.mark.parametrize("name", ["ur5e", "pa10_vision"])
def test_what_a_link_is_led_onto_is_let_go_of_in_other_cells_too(play, name):
    """A stick of 50 mm/s: links that no sensor sees pressed the table with 594 and 555 N."""
    run = play(
        {"at_s": 0.0, "cmd/posture": {"posture": "ready"}},
        {
            "at_s": 2.6,
            "cmd/joystick": {"twist": [0.0, 0.0, -0.05, 0.0, 0.0, 0.0], "expressed_in": "base"},
        },
        seconds=9.0,
        cell=load_cell(name),
    )
    force = [float(np.linalg.norm(truth.contact_force)) for truth in run.truths]
    assert max(force) > 50.0
    assert run.summary["mode"] == "hold"
    assert run.events("touched")
    assert max(force[-50:]) < 30.0


# A joint at full speed, and the middle of a crate in its tool's way, where the cell has nothing.
CRASHES = {
    "ur5e": ([0.0, 1.5, 0.0, 0.0, 0.0, 0.0], None),
    "gantry": ([0.0, 0.6] + 7 * [0.0], (-0.45, 0.35, 0.89)),
    "pa10_hand": ([0.0, 0.0, 0.0, 0.0, 0.0, -3.0, 0.0], (0.75, 0.0, 0.46)),
}


def crashed(name, *steps):
    """Return a run of a joint that goes on at full speed into something."""
    rates, crate = CRASHES[name]
    cell = load_cell(name)
    if crate is not None:
        crates = [{"name": "crate", "xyz": crate, "half_size": (0.04, 0.04, 0.04)}]
        cell = altered(cell, {"rig.boxes": crates})
    jog = {"at_s": 2.5, "for_s": 2.0, "cmd/jog": {"rates": rates}}
    posture = {"at_s": 0.0, "cmd/posture": {"posture": "ready"}}
    script = {"duration_s": 5.5, "step": [posture, jog, *steps]}
    simulation = Simulation(cell, Script.model_validate(script))
    return Run(simulation, simulation.run())


def stands_free(run):
    assert run.events("touched")
    assert run.events("fault") == []
    assert run.summary["mode"] == "hold"
    force = [float(np.linalg.norm(truth.contact_force)) for truth in run.truths]
    assert max(force) > 100.0
    assert max(force[-50:]) < 5.0


@pytest.mark.parametrize("name", CRASHES)
def test_a_joint_at_full_speed_that_meets_something_stops_in_its_window_and_lets_go(name):
    """With windows of 0.06 rad the drives quick-stopped, and 558, 972 and 285 N stayed."""
    stands_free(crashed(name))


@pytest.mark.parametrize("factor", [0.1, 0.01])
def test_a_reduced_speed_that_is_told_just_before_a_contact_hurts_nobody_for_longer(factor):
    """Stops took that part of the acceleration, and giving way of its rate.

    Told 0.1, ur5e lost its following window, and 331 N stayed; 387 N for seconds, told 0.01.
    """
    run = crashed("ur5e", {"at_s": 3.14, "operator/speed": {"factor": factor}})
    (told,), felt = run.events("speed_set"), run.events("touched")[0]
    assert 0.0 < felt.time_s - told.time_s < 0.06
    stands_free(run)
    at_rest_s = next(state.time_s for state in run.states if state.mode == "hold")
    assert at_rest_s - felt.time_s < 0.25
    force = [np.linalg.norm(t.contact_force) for t in run.truths if t.time_s > felt.time_s + 0.5]
    assert max(force) < 5.0
