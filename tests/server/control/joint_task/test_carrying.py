"""Two arms carry a beam: internal forces, stretch and where it is, by the truth of the physics."""

import mujoco
import numpy as np
import pytest
from telerobot.server.control.inputs import Intent, PathGoal, Pushed
from telerobot.server.control.joint_task.forces import Grasping, without_load
from telerobot.server.control.spatial import Kinematics, Pose, jacobian_at, rotate_twist

from .carrying import Carrying, T, pair

FORWARD, UP, YAW = np.eye(6)[[0, 2, 5]]


@pytest.fixture
def cell(tmp_path):
    """Return the pair without nodes; lines of its file may be changed."""
    return lambda *changes: pair(tmp_path, *changes)


@pytest.mark.parametrize("axis", range(3))
def test_a_misfit_of_2_mm_is_melted_in_half_a_second(cell, axis):
    run, misfit = Carrying(cell()), np.zeros(3)
    run.force_gain(5e-4, 0.025)  # K_F k T = 0.25
    run.run(0.1)
    misfit[axis] = 2e-3
    run.world.beam.shift(1, misfit)
    force, _, _ = run.run(0.5)
    assert force[0] > 5.0, "the misfit pressed nothing"
    assert force[-1] < 2.0


def misplaced(world):
    """Put one arm 5 mm and 5 mrad from where the cell has it."""
    root, turn = world.model.body("right.base").id, np.zeros(4)
    world.model.body_pos[root] += [0.003, 0.004, 0.0]
    mujoco.mju_axisAngle2Quat(turn, np.array([0.0, 0.0, 1.0]), 0.005)
    both = np.zeros(4)
    mujoco.mju_mulQuat(both, turn, world.model.body_quat[root])
    world.model.body_quat[root] = both


@pytest.mark.parametrize("stick", [0.1 * FORWARD, 0.15 * YAW], ids=["forward", "yaw"])
def test_an_arm_that_is_misplaced_does_not_press_the_beam(cell, stick):
    melted, pressed = Carrying(cell(), misplaced), Carrying(cell(), misplaced)
    pressed.force_gain(0.0, 0.0)
    force, _, _ = melted.run(1.2, stick)
    without, _, _ = pressed.run(1.2, stick)
    assert force.max() < 3.0
    assert without[-1] > 4.5
    # The arms' views of the beam are told anew as they drift, and stay near each other.
    assert melted.outputs[0].holding.apart < 2e-3


TRUE = "mass = 5.0\ngrasp"
"""The beam's mass in truth; it is told 5 kg."""


def told_wrong(cell, mass, com="[0.0, 0.0, 0.0]"):
    """Return the pair with a beam that is told 5 kg, at its middle."""
    return Carrying(cell((TRUE, f"mass = {mass}\ncom = {com}\ngrasp")))


@pytest.mark.parametrize("mass", [5.0, 5.5, 4.5, 7.0, 3.5, 9.0])
def test_a_load_that_is_told_wrong_neither_sinks_nor_rises(cell, mass):
    run = told_wrong(cell, mass)
    before = run.world.beam.pose()[0]
    _, _, place = run.run(2.0)
    assert np.abs(np.array(place) - before).max() < 1e-3
    assert abs(place[-1] - place[-50]).max() < 2e-5
    assert run.outputs[0].holding.load[0] == pytest.approx(mass - 5.0, abs=0.02)


def test_a_load_whose_centre_is_told_wrong_does_not_turn(cell):
    run = told_wrong(cell, 5.0, "[0.05, 0.0, 0.0]")
    before = run.world.beam.pose()[1]
    run.run(2.0)
    _, turned = run.world.beam.pose()
    assert np.arccos((np.trace(before.T @ turned) - 1) / 2) < 5e-3
    np.testing.assert_allclose(run.outputs[0].holding.load, [0, 0.25, 0, 0], atol=0.02)


def test_what_was_found_to_weigh_more_still_does_once_it_is_turned(cell):
    run = told_wrong(cell, 5.5, "[0.05, 0.0, 0.0]")
    run.run(1.0)
    before = run.world.beam.pose()
    run.run(2.5, 0.2 * YAW)
    run.run(1.0)
    after = run.world.beam.pose()
    np.testing.assert_allclose(run.outputs[0].holding.load, [0.5, 0.275, 0.0, 0.0], atol=0.02)
    assert abs(after[0] - before[0]).max() < 2e-3
    assert abs(after[1][2] - before[1][2]).max() < 2e-3  # level as before


def test_a_load_that_grows_on_the_way_sinks_little(cell):
    run = Carrying(cell())
    run.run(0.5)
    before = run.world.beam.pose()[0]
    run.world.beam.lift(np.array([0.0, 0.0, -0.5 * 9.81]))
    _, _, place = run.run(3.0, 0.02 * FORWARD)
    assert abs(place[-1][2] - before[2]) < 2e-3
    assert place[-1][0] - before[0] > 0.05
    assert abs(place[-1][2] - place[-50][2]) < 5e-5


def on_a_table(run, seconds, stick=None):
    """Let a table of 20 kN/m carry 20 N of the beam; return what it carries in each tick [N]."""
    beam, table, pressed = run.world.beam, run.world.beam.pose()[0][2] + 1e-3, []
    for _ in range(round(seconds / T)):
        pressed.append(2e4 * max(0.0, table - beam.pose()[0][2]))
        beam.lift(np.array([0.0, 0.0, pressed[-1]]))
        run.tick(stick)
    return pressed


def test_what_the_load_rests_on_is_given_way_to_and_no_weight(cell):
    run = Carrying(cell())
    pressed = on_a_table(run, 3.0)
    assert max(pressed) > 15.0
    assert pressed[-1] < 1.0
    assert abs(run.outputs[0].holding.load[0]) < 0.1


def test_what_a_stick_presses_on_is_no_weight(cell):
    """Force control and stick agree on K_F f / 2 = 2 mm/s, and the beam stands there."""
    run = Carrying(cell())
    pressed = on_a_table(run, 4.0, -0.002 * UP)
    assert pressed[-1] == pytest.approx(13.3, abs=1.0)
    assert abs(run.outputs[0].holding.load[0]) < 0.05


def test_a_wrench_that_is_asked_for_is_exerted_and_no_weight(cell):
    run = Carrying(cell())
    run.wrench_desired = np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0])
    pressed = on_a_table(run, 3.0)
    assert pressed[-1] == pytest.approx(10.0, abs=1.0)
    assert abs(run.outputs[0].holding.load[0]) < 0.01


STOPS = {
    "forward and yaw": [0.15, 0, 0, 0, 0, 0.3],
    "across and pitch": [0, -0.15, 0, 0, 0.3, 0],
    "up and roll": [0, 0, 0.15, 0.3, 0, 0],
    "every way": [0.1, 0.1, 0.05, 0.2, 0.1, -0.2],
}


@pytest.mark.parametrize("stick", STOPS.values(), ids=STOPS)
def test_a_verified_stop_neither_presses_nor_stretches_the_beam(cell, stick):
    run = Carrying(cell())
    _, _, place = run.run(0.6, stick)
    assert np.linalg.norm(place[-1] - place[-2]) / T > 0.1
    force, stretch, _ = run.run(0.6, intent=Intent.STOP)
    assert all(output.at_rest for output in run.outputs)
    assert force.max() < 10.0
    assert stretch.max() < 0.5e-3


def test_one_arms_brakes_fall_in_and_the_other_stops_two_ticks_later(cell):
    run = Carrying(cell())
    _, _, place = run.run(0.8, 0.25 * UP)
    assert (place[-1] - place[-2])[2] / T == pytest.approx(0.25, rel=0.02)
    for joint in range(7):
        run.world.set_brake(joint, closed=True)
        run.loops.release(joint)
        run.stopped.add(joint)
    before, _, _ = run.run(2 * T, 0.25 * UP)
    drives = run.cell.parts[1].config.mechanism.drives
    for joint, drive in enumerate(drives, start=7):
        run.loops.ramp_down(joint, drive.quick_stop_deceleration)
        run.stopped.add(joint)
    after, _, _ = run.run(0.5, intent=Intent.STOP)
    assert max(before.max(), after.max()) < 30.0


def test_the_beam_goes_where_the_stick_leads_it(cell):
    run = Carrying(cell())
    _, _, before = run.run(0.5, 0.1 * FORWARD)
    _, _, after = run.run(0.5, 0.1 * FORWARD)
    np.testing.assert_allclose(after[-1] - before[-1], [0.05, 0.0, 0.0], atol=2e-4)


def test_a_nudge_during_a_pose_move_is_paid_back_at_the_goal(cell):
    run = Carrying(cell())
    target = run.outputs_of_rest().shared.T_world_mrf
    target = target._replace(p=target.p + 0.05)
    goal = PathGoal(target, serial=1)
    run.run(0.5, 0.05 * UP, goal=goal)
    force, _, _ = run.run(3.0, goal=goal)
    assert run.outputs[0].shared.at_goal
    at, _ = run.world.beam.pose()
    # the pads give way by 0.5 mm under the weight
    np.testing.assert_allclose(at, target.p - [0, 0, 5 * 9.81 / 1e5], atol=1e-3)
    assert force.max() < 5.0


def test_the_mrf_moves_to_an_end_of_the_beam_and_turns_about_it(cell):
    run = Carrying(cell())
    run.run(0.1)
    run.move_mrf([0.0, 0.55, 0.0])
    _, R = run.world.beam.pose()
    end = lambda: run.world.beam.pose()[0] + run.world.beam.pose()[1] @ [0.0, 0.55, 0.0]  # noqa: E731
    before = end()
    force, _, _ = run.run(1.0, 0.1 * YAW)
    np.testing.assert_allclose(end(), before, atol=1e-3)
    _, turned = run.world.beam.pose()
    assert np.arccos((np.trace(R.T @ turned) - 1) / 2) == pytest.approx(0.09, abs=0.02)
    assert force.max() < 5.0


def test_hold_bleeds_internal_force_off(cell):
    run = Carrying(cell())
    run.run(0.1)
    run.world.beam.shift(1, np.array([0.0, 2e-3, 0.0]))
    force, _, place = run.run(1.5, intent=Intent.HOLD)
    assert force[:3].max() > 25.0
    assert force[-1] < 15.0  # its threshold
    np.testing.assert_allclose(place[-1], place[0], atol=2e-3)
    assert not run.outputs[0].shared.bleeding


def test_internal_force_beyond_its_bound_stops_the_arms_by_name(cell):
    run = Carrying(cell())
    run.run(0.5, 0.1 * FORWARD)
    run.world.beam.shift(1, np.array([0.0, 6e-3, 0.0]))
    run.run(0.1, 0.1 * FORWARD)
    assert "internal_force:beam" in run.outputs[0].limits
    assert run.outputs[0].holding.strained
    assert "verified_stop" in run.outputs[0].limits
    run.run(0.4, 0.1 * FORWARD)
    assert all(output.at_rest for output in run.outputs)


def test_an_internal_moment_beyond_its_bound_stops_the_arms_and_hold_bleeds_it_off(cell):
    run = Carrying(cell())
    run.run(0.5, 0.1 * FORWARD)
    # about the beam itself, where no lever makes a force of it
    run.world.beam.turn(1, np.array([0.0, 0.05, 0.0]))
    run.run(0.05, 0.1 * FORWARD)
    assert "internal_moment:beam" in run.outputs[0].limits
    assert run.outputs[0].holding.strained == "internal_moment"
    assert run.outputs[0].holding.internal_force < 60.0
    run.run(0.4, 0.1 * FORWARD, intent=Intent.STOP)
    assert all(output.at_rest for output in run.outputs)
    run.run(1.5, intent=Intent.HOLD)
    assert run.outputs[0].holding.internal_moment < 4.0
    assert not run.outputs[0].shared.bleeding


def test_an_arm_whose_sensor_is_stale_gives_way_to_nothing(cell):
    run = Carrying(cell())
    run.run(0.1, blind=(1,))
    assert run.outputs[0].holding.internal_force is None
    assert run.outputs[1].wrench is None
    assert not run.outputs[1].twists["force"].any()


def test_views_that_drift_apart_are_told_and_follow_their_mean(cell):
    run = Carrying(cell())
    run.run(0.1)
    assert run.outputs[1].holding.redefined == 0
    run.world.beam.shift(1, np.array([0.0, 0.0, 5e-3]))
    run.run(1.0)
    run.world.beam.shift(1, np.array([0.0, 0.0, 5e-3]))
    force, _, place = run.run(4.0)
    assert run.outputs[1].holding.redefined >= 1
    assert run.outputs[1].holding.apart < 1e-3
    # What they disagreed on is not paid back as a motion.
    assert force[-100:].max() < 1.0
    np.testing.assert_allclose(place[-1], place[-100], atol=1e-4)


def test_a_beam_that_slips_out_of_one_grasp_stops_both_arms(cell):
    run = Carrying(cell())
    run.run(0.5, 0.1 * FORWARD)
    run.world.beam.let_go(1)
    run.run(0.6, 0.1 * FORWARD)
    assert "slipped:beam" in run.outputs[0].limits
    assert [output.holding.slipped for output in run.outputs] == [False, True]
    assert all(output.at_rest for output in run.outputs)
    before = run.command.copy()
    run.run(0.5, intent=Intent.HOLD)  # and no arm goes up or down after its share
    np.testing.assert_allclose(run.command, before, atol=1e-6)


def test_a_beam_that_slipped_is_noticed_where_the_other_sensor_tells_nothing(cell):
    """All of the weight on one arm saturates its sensor."""
    run = Carrying(cell())
    run.run(0.3, intent=Intent.HOLD, blind=(0,))
    assert not any(output.holding.slipped for output in run.outputs)
    run.world.beam.let_go(1)
    run.run(0.2, intent=Intent.HOLD, blind=(0,))
    assert [output.holding.slipped for output in run.outputs] == [False, True]


def test_a_beam_that_is_set_down_on_something_did_not_slip(cell):
    run = Carrying(cell())
    run.run(0.1)
    beam = run.world.beam
    for _ in range(40):
        # as if a table carried nine tenths of it
        beam.lift(np.array([0.0, 0.0, 0.9 * 5 * 9.81]))
        run.tick()
    assert not any(output.holding.slipped for output in run.outputs)


@pytest.mark.parametrize(
    ("left", "slipped"),
    [((16.6, 15.5, 2.0), False), ((1.0, -0.5, 2.0), True), ((0.0, 0.0, -20.0), False)],
    ids=["pressed on what carries it", "empty", "pressed down"],
)
def test_a_grasp_out_of_which_the_payload_slipped_exerts_nothing_in_any_direction(left, slipped):
    """A node that one end of a beam stands on takes the load off that arm alone."""
    share = np.array([0.0, 0.0, 24.5, 0.0, 0.0, 0.0])
    exerted = (np.array([*left, 0.0, 0.0, 0.0]), np.array([8.0, 14.0, 39.0, 0.0, 0.0, 0.0]))
    forces = Grasping(np.zeros((2, 3)), np.array([share, share]), exerted, None, None, None)
    empty, slips = without_load(forces, np.array([0.0, 0.0, 1.0]))
    assert (empty.tolist(), slips.tolist()) == ([slipped, False], [slipped, False])


def test_what_a_grasp_is_off_by_stands_in_the_torques_of_the_drives(rng):
    """Beyond friction, and while the arm was touched; its share alone is no push."""
    T, J = Pose.from_xyz_rpy((0.3, 0.1, 0.4), (0.2, -0.5, 1.0)), rng.uniform(-1.0, 1.0, (6, 7))
    p, desired, exerted = rng.uniform(-0.5, 0.5, (2, 3)), *rng.normal(size=(2, 2, 6)) * 30.0
    forces, k = Grasping(p, desired, (None, None), None, None, None), Kinematics(T, T, J)
    for i in range(2):
        at_grasp = jacobian_at(J, T.R @ p[i])

        def pushed(h, bound, touched=True, at_grasp=at_grasp):
            by_payload = -at_grasp.T @ rotate_twist(T.R, h)
            return Pushed(by_payload, np.zeros(7), np.full(7, bound), touched)

        off = forces.off_by_drives(i, k, pushed(exerted[i], 1e-9))
        assert off == pytest.approx(desired[i] - exerted[i], abs=1e-6)
        assert not forces.off_by_drives(i, k, pushed(desired[i], 0.1)).any()
        assert not forces.off_by_drives(i, k, pushed(exerted[i], 1e4)).any()
        assert forces.off_by_drives(i, k, pushed(exerted[i], 0.1, touched=False)) is None
        assert forces.off_by_drives(i, k, None) is None


def test_arms_remember_which_way_a_joint_was_held_up_until_it_is_free(cell):
    """So that what leads back out of it is told from what leads on into it, tick by tick."""
    carrying = Carrying(cell())
    s2 = 1
    for _ in range(30):
        carrying.tick(0.05 * FORWARD)
    left = carrying.memory.arms[0].resistance
    assert not left.pressed.any()
    carrying.world.set_brake(s2, closed=True)
    pressed = []
    for _ in range(60):
        carrying.tick(0.05 * FORWARD + 0.03 * UP)
        pressed.append(carrying.memory.arms[0].resistance.pressed[s2])
    held_up = np.flatnonzero(pressed)
    assert held_up.size > 10
    assert (np.diff(held_up) == 1).all(), "it was forgotten meanwhile"
    carrying.world.set_brake(s2, closed=False)
    for _ in range(60):
        carrying.tick()
    assert not carrying.memory.arms[0].resistance.pressed.any()
