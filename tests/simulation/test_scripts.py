"""Every shipped script keeps what it was written to show."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell, shipped
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.simulation import Simulation

from .conftest import Run

CELL_OF = {
    "ur5e_tour": "ur5e",
    "hand_push": "pa10_hand",
    "hand_swell": "pa10_hand",
    "reflect_rate": "pa10_reflect",
    "reflect_pose": "pa10_reflect",
    "reach_along": "gantry",
    "skid": "rover_skid",
    "steer_aside": "rover_aside",
}
ELSEWHERE = {
    name for name in shipped("scripts") if name.startswith(("vision_", "peg_", "obstacle_"))
}
"""Scripts that need pictures, a peg or obstacles: `test_vision.py` and its like play them."""
ELSEWHERE |= {
    "two_arms",
    "two_nodes",
    "two_nodes_stiff",
    "two_nodes_search",
    "see_and_insert",
    "carry",
    "carry_plate",
    "stop_together",
}
"""`test_pa10_two.py`, `test_pa10_pair.py`, `test_view_together.py`; the stiff one must not be."""
ELSEWHERE |= {"shifted", "maze", "maze_space", "tail", "tail_space", "two_tunnels"}
ELSEWHERE |= {"touch_inside", "figure_5", "fed"}
"""`test_tunnel.py`, `test_tunnel_faults.py`, `test_fed.py`, `test_tail.py` and its sister."""
ELSEWHERE |= {"told_tunnel", "told_gap"}  # `test_told_tunnel.py`
ELSEWHERE |= {"between_boxes"}  # `test_found_tunnel.py`
ELSEWHERE |= {"figure_4"}  # `test_planar3.py`
ELSEWHERE |= {"drive_and_reach", "hold_in_world"}  # `test_rover.py`
ELSEWHERE |= {"drive_past"}  # `test_rover_beside.py`
ELSEWHERE |= {"torso"}  # `test_pa10_torso.py`
ELSEWHERE |= {"eyes"}  # `test_pa10_eyes.py`
ELSEWHERE |= {"bridge", "bridge_off"}
"""`test_bridge.py` plays the like, nearer."""
FRAMES = {"conveyor", "platform", "frames_here", "all_sources", "see_and_press"}
"""Scripts that `test_frames.py`, `test_all_sources.py` and `test_waiting.py` play."""
FIELD = {n for n in shipped("scripts") if n.startswith("sight_line_")} | {"round_obstacle"}
"""Scripts that `test_sight_line.py` and `test_virtual_link.py` play."""


def run_shipped(name, cell):
    simulation = Simulation(cell, load_script(name))
    return Run(simulation, simulation.run())


@pytest.mark.parametrize("name", sorted(set(shipped("scripts")) - ELSEWHERE - FRAMES - FIELD))
def test_every_shipped_script_plays_without_refusal_fault_or_violation(name):
    run = run_shipped(name, load_cell(CELL_OF.get(name, "pa10")))
    assert run.result.ok, [str(row) for row in run.result.expected if not row.met]
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    assert [e for e in run.simulation.events if e.severity == "error"] == []


@pytest.mark.parametrize("name", shipped("scripts"))
def test_every_shipped_script_says_what_it_is_to_reach(name):
    expect = load_script(name).expect
    bounds = expect.model_fields_set - {"mode", "events", "refused"}
    assert bounds, "nothing that the physics could judge"
    assert expect.mode in (
        ("hold",) if name in ("stop_together", "two_nodes_stiff") else ("enabled", None)
    )


def test_a_pose_move_is_within_a_millimetre_right_after_the_paths_end(pa10):
    run = run_shipped("pose_move", pa10)
    first, last = run.at(0.49), run.at(0.6)
    moved = np.array(last.target_mrf[:3]) - first.pose_mrf[:3]
    assert np.linalg.norm(moved) == pytest.approx(0.2, abs=1e-3)
    assert run.summary["tool_error_m"] < 1e-3
    assert run.summary["tool_error_rad"] < 2e-3


@pytest.mark.parametrize("stiffness", [2_000.0, 20_000.0])
def test_pushing_the_wall_settles_at_rate_over_gain_whatever_its_stiffness(pa10, stiffness):
    cell = altered(pa10, {"rig.wall.stiffness": stiffness})
    run = run_shipped("wall_push", cell)
    expected = 0.0075 / pa10.config.sources.force.gain[0]
    assert run.summary["contact_force_n"] == pytest.approx(expected, abs=max(0.05 * expected, 0.3))
    # The wrench that operators see is the force that the arm exerts: along +x of the World.
    assert run.states[-1].wrench_mrf[2] == pytest.approx(expected, abs=1.0)
    assert run.truths[-1].contact_force[0] > 0.0


@pytest.mark.parametrize("stiffness", [2_000.0, 20_000.0])
def test_the_first_touch_of_the_wall_does_not_bounce(pa10, stiffness):
    """Contact is kept from the first touch on, and never above what the stick asks for by 5 %."""
    cell = altered(pa10, {"rig.wall.stiffness": stiffness})
    run = run_shipped("wall_push", cell)
    forces = np.linalg.norm([truth.contact_force for truth in run.truths], axis=1)
    first = int(np.argmax(forces > 0.0))
    assert forces[first] > 0.0
    assert (forces[first:] > 0.0).all()
    assert forces.max() < 1.05 * 0.03 / pa10.config.sources.force.gain[0]


def test_full_stretch_is_entered_and_left_at_once(pa10):
    run = run_shipped("stretch", pa10)
    out, held, back = run.at(6.0), run.at(13.9), run.at(15.0)
    assert held.pose_mrf[2] > out.pose_mrf[2]
    assert held.sigma_min < 0.5 * pa10.config.resolve.singular_region
    # Half of the commanded retreat is made within the first second, the start-up included.
    assert held.pose_mrf[2] - back.pose_mrf[2] > 0.5 * 0.1 * 1.0
    assert np.abs(run.at(13.9).dq_command).max() < 0.5


def test_a_joint_limit_is_met_and_left(pa10):
    run = run_shipped("joint_limit", pa10)
    met, left = run.at(7.9), run.at(9.9)
    limit = pa10.robot.joints[1].lower
    assert 0.0 < met.q_command[1] - limit < 0.03
    assert "joint_limit:s2" in met.limits
    assert left.q_command[1] - met.q_command[1] > 0.15


def test_a_stick_pushed_during_a_pose_move_and_released_still_reaches_the_target(pa10):
    run = run_shipped("nudge", pa10)
    pushed = run.at(2.4)
    aside = np.array(pushed.pose_mrf[:3]) - pushed.target_mrf[:3]
    assert np.linalg.norm(aside) > 0.02
    assert run.summary["tool_error_m"] < 1e-3
    assert run.summary["tool_error_rad"] < 2e-3
    assert run.states[-1].at_goal
