"""Arms on one torso: all sixteen joints against a dense least-squares solution, and the physics."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.drivers.rig.physics.world import World
from telerobot.server.commands.commands import Commands
from telerobot.server.control.forest import Forest, standing_on
from telerobot.server.control.inputs import Inputs, Intent, StickCommand
from telerobot.server.control.scene import Body, Moved
from telerobot.server.control.spatial import Pose
from telerobot.server.control.tick import Control
from telerobot.server.control.torso import DAMPING, Share, shared_rates
from telerobot.tools.checks.drives import carried

LENGTH = 0.3
D = np.array([0.5, 1.0])
WIDE = np.full(2, 1e3)
ROWS = np.array([1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH])


@pytest.fixture(scope="module")
def cell():
    return load_cell("pa10_torso")


@pytest.fixture(scope="module")
def world(cell):
    return World(cell)


@pytest.fixture(scope="module")
def control(cell):
    return Control.of(cell)


def posture(cell, rng=None, size=0.4):
    q = np.concatenate([np.array(p.config.mechanism.postures["ready"]) for p in cell.parts])
    if rng is not None:
        q = q + rng.uniform(-size, size, len(q)) * np.r_[1.0, 0.3, np.ones(14)]
    return q


def true_jacobian(world, q, arm):
    """Return an MRF's Jacobian (6, 16) by the physics, and its place (3,)."""
    world.q[:] = q
    mujoco.mj_kinematics(world.model, world.data)
    mujoco.mj_comPos(world.model, world.data)
    J, site = np.zeros((6, world.n)), world.model.site(f"{arm}.mrf").id
    mujoco.mj_jacSite(world.model, world.data, J[:3], J[3:], site)
    return J, world.data.site_xpos[site].copy()


def stacked(shares, weight, damping):
    """Return the rates of all joints, the shared ones first: least squares of one dense system."""
    k, own = len(weight), [share.J.shape[1] for share in shares]
    first = np.cumsum([k, *own])
    A = [np.diag(np.r_[1.0 / weight, np.ones(sum(own))])]
    b = [np.zeros(k + sum(own))]
    for i, share in enumerate(shares):
        rows = np.zeros((6, k + sum(own)))
        rows[:, :k], rows[:, first[i] : first[i + 1]] = share.S, share.J
        A.append(ROWS[:, None] * rows / damping)
        b.append(ROWS * share.twist / damping)
    return np.linalg.lstsq(np.vstack(A), np.concatenate(b), rcond=None)[0]


def drawn(rng, arms=2, joints=7):
    return [
        Share(rng.normal(size=(6, 2)), rng.normal(size=(6, joints)), rng.normal(size=6))
        for _ in range(arms)
    ]


@pytest.mark.parametrize(("arms", "joints"), [(1, 7), (2, 7), (3, 6), (2, 5)])
def test_shared_rates_are_those_of_all_joints_in_one_dense_system(arms, joints):
    """Redundant, just enough, and too few joints."""
    rng = np.random.default_rng(arms * joints)
    for _ in range(20):
        shares = drawn(rng, arms, joints)
        found = shared_rates(shares, D, -WIDE, WIDE, LENGTH)
        assert found == pytest.approx(stacked(shares, D, DAMPING)[:2], rel=1e-7, abs=1e-9)


def test_of_a_shared_joint_at_its_bound_the_others_make_up_for_the_rest():
    rng = np.random.default_rng(5)
    for _ in range(20):
        shares = drawn(rng)
        free = shared_rates(shares, D, -WIDE, WIDE, LENGTH)
        low, high = np.minimum(0.4 * free, 0.0), np.maximum(0.4 * free, 0.0)
        low[1], high[1] = -1e3, 1e3
        found = shared_rates(shares, D, low, high, LENGTH)
        assert found[0] == pytest.approx(0.4 * free[0])
        left = [Share(s.S[:, 1:], s.J, s.twist - s.S[:, 0] * found[0]) for s in shares]
        alone = stacked(left, D[1:], DAMPING)[0]
        assert found[1] == pytest.approx(alone, rel=1e-6, abs=1e-9)


def test_opposite_demands_of_two_equal_arms_leave_the_torso_where_it_is():
    rng = np.random.default_rng(6)
    S, J, twist = rng.normal(size=(6, 2)), rng.normal(size=(6, 7)), rng.normal(size=6)
    found = shared_rates([Share(S, J, twist), Share(S, J, -twist)], D, -WIDE, WIDE, LENGTH)
    assert found == pytest.approx(np.zeros(2), abs=1e-12)


def test_links_and_tools_are_where_the_physics_has_them(cell, world):
    """Joints' frames and tools by MuJoCo's bodies and sites, at postures of all joints."""
    forest, rng = Forest(cell), np.random.default_rng(3)
    for _ in range(5):
        q = posture(cell, rng)
        world.q[:] = q
        mujoco.mj_kinematics(world.model, world.data)
        frames = forest.frames(q[None])[0]
        for j, name in enumerate(cell.joints):
            body = int(world.model.joint(name).bodyid[0])
            np.testing.assert_allclose(frames[j, :, 3], world.data.xpos[body], atol=1e-9)
        for part in cell.parts:
            body, T = forest.body_of(part.prefix + part.config.mechanism.tip_link)
            at = frames[body - 1][:, :3] @ T.p + frames[body - 1][:, 3]
            tip = world.model.body(part.prefix + part.config.mechanism.tip_link).id
            np.testing.assert_allclose(at, world.data.xpos[tip], atol=1e-9)


def given(cell, control, q, q_measured, **told):
    """Return the inputs of all arms; those of an arm by its name, as in `left={…}`."""
    found = []
    torso = control.arms[0].mechanism
    for part, joints in zip(cell.parts, control.parts, strict=True):
        moved = None
        if part.config.mechanism.on is not None:
            base, seen = (torso.pose_wrist(at[:2]) @ standing_on(part) for at in (q, q_measured))
            moved = Moved(Body.standing(base), Body.standing(Pose.identity()), seen)
        settings = Commands.from_cell(part).settings.for_control()
        more = told.get(part.config.mechanism.name, {})
        at = q_measured[joints]
        found.append(Inputs(0.0, Intent.MOVE, at, settings, moved=moved, **more))
    return found


def led(cell, control, ticks=60, q=None, behind=0.0, **told):
    """Yield posture, outputs, and what was granted of the rates, tick by tick.

    Joints are measured `behind` (16,) their commands.
    """
    memory = control.seed(posture(cell) if q is None else q)
    before = memory.commanded.motion.q
    for _ in range(ticks):
        q = memory.commanded.motion.q
        memory, outputs = control.tick(memory, given(cell, control, q, before - behind, **told))
        before = q
        yield q, outputs, memory.commanded.motion


def rates(outputs):
    return np.concatenate([output.dq_asked for output in outputs])


def stick(*twist):
    return {"stick": StickCommand(np.array(twist), np.eye(3))}


ONE, OTHER = stick(0.03, -0.02, 0.04, 0.05, 0.0, -0.1), stick(-0.02, 0.03, 0.05, 0.0, 0.1, 0.0)


def test_both_tools_do_what_they_are_asked_for_by_all_sixteen_joints(cell, control, world):
    """The tick's rates, by the physics' Jacobians; the torso's are those of the dense system."""
    size = 0.0
    for q, outputs, _ in led(cell, control, left=ONE, right=OTHER):
        dq, shares = rates(outputs), []
        for i, name in ((1, "left"), (2, "right")):
            J, _ = true_jacobian(world, q, name)
            twist = outputs[i].twist
            assert J @ dq == pytest.approx(twist, abs=1e-9)
            shares.append(Share(J[:, :2], J[:, control.parts[i]], twist))
        assert dq[:2] == pytest.approx(stacked(shares, D, DAMPING)[:2], abs=1e-9)
        size = np.abs(dq[:2]).max()
    assert size > 0.01


def test_without_damping_that_is_the_least_weighted_motion_of_all(cell, control, world):
    """Least |D⁻¹ q̇_s|² + |q̇|² that does both twists, of one pseudoinverse, within 3 %."""
    *_, (q, outputs, _) = led(cell, control, left=ONE, right=OTHER)
    J = np.vstack([true_jacobian(world, q, name)[0] for name in ("left", "right")])
    twist = np.concatenate([outputs[i].twist for i in (1, 2)])
    W = np.diag(np.r_[D, np.ones(14)])
    least = W @ np.linalg.pinv(J @ W) @ twist
    assert rates(outputs)[:2] == pytest.approx(least[:2], rel=0.03, abs=1e-4)


def test_a_tool_that_is_asked_for_nothing_stays_while_the_other_takes_the_torso_along(
    cell, control, world
):
    ticks = list(led(cell, control, ticks=150, left=stick(0.0, 0.08, 0.04, 0.0, 0.0, 0.0)))
    places = {
        name: [true_jacobian(world, q, name)[1] for q, *_ in ticks] for name in ("left", "right")
    }
    way = ticks[-1][0] - ticks[0][0]
    assert abs(way[1]) > 0.02
    assert np.linalg.norm(places["left"][-1] - places["left"][0]) > 0.1
    off = np.linalg.norm(np.array(places["right"]) - places["right"][0], axis=1)
    assert off.max() < 1e-3


def test_arms_answer_a_torso_that_is_driven_and_it_goes_as_told(cell, control, world):
    ticks = list(led(cell, control, ticks=120, torso=stick(0.0, 0.0, -0.05, 0.0, 0.0, 0.2)))
    q, outputs, _ = ticks[-1]
    dq = rates(outputs)
    assert dq[:2] == pytest.approx([0.2, -0.05], abs=1e-9)
    for name in ("left", "right"):
        assert np.abs(true_jacobian(world, q, name)[0] @ dq).max() < 1e-9
        way = true_jacobian(world, q, name)[1] - true_jacobian(world, ticks[0][0], name)[1]
        assert np.linalg.norm(way) < 2e-3


def test_an_arm_that_is_jogged_or_led_in_its_base_asks_nothing_and_is_carried_along(
    cell, control, world
):
    jog = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for told in ({"jog": jog}, {**ONE, "ground": "base"}):
        *_, (q, outputs, _) = led(cell, control, left=told)
        assert not outputs[0].dq_asked.any()
        *_, (q, outputs, _) = led(cell, control, left=told, torso=stick(0, 0, 0, 0, 0, 0.2))
        carried = true_jacobian(world, q, "left")[0][:, :2] @ outputs[0].dq_asked
        assert np.abs(carried).max() > 0.1
        own = outputs[1]
        assert true_jacobian(world, q, "left")[0][:, 2:9] @ own.dq_asked == pytest.approx(
            own.twist, abs=1e-9
        )


def test_a_lift_at_its_limit_leaves_the_rest_to_the_arms(cell, control, world):
    """Bent by no barrier: what both tools are granted is what they are asked for."""
    start, upper, granted = posture(cell), cell.robot.joints[1].upper, {}
    start[1] = upper - 0.012
    for q, outputs, motion in led(cell, control, 120, start, left=stick(0, 0, 0.1, 0, 0, 0)):
        for i, name in ((1, "left"), (2, "right")):
            granted[name] = true_jacobian(world, q, name)[0] @ motion.dq
            assert np.abs(granted[name] - outputs[i].twist).max() < 0.01
        assert q[1] < upper - 0.0099
    assert q[1] > start[1] + 1e-3
    assert granted["left"][2] > 0.09
    assert np.abs(granted["right"]).max() < 1e-3


def test_a_lift_that_its_leash_holds_is_made_up_for_by_both_arms(cell, control, world):
    """Barriers know that it moves two tools: one goes on, and the other stays."""
    behind = np.zeros(16)
    behind[1] = cell.config.mechanism.drives[1].leash + 5e-4
    ticks = led(cell, control, behind=behind, left=stick(0.0, 0.0, 0.1, 0.0, 0.0, 0.0))
    *_, (q, outputs, motion) = ticks
    assert outputs[0].dq_asked[1] > 0.02
    assert motion.dq[1] == pytest.approx(0.0, abs=1e-6)
    granted = {n: true_jacobian(world, q, n)[0] @ motion.dq for n in ("left", "right")}
    assert granted["left"][2] > 0.02
    assert np.abs(np.delete(granted["left"], 2)).max() < 0.002
    assert np.abs(granted["right"]).max() < 0.002


def test_a_stop_goes_to_rest_in_proportion_and_the_tools_stay_on_their_line(cell, control, world):
    *_, (_, _, motion) = led(cell, control, left=ONE, right=OTHER)
    stop = control.limiter.verified_stop(motion)
    ends = [stop.at(t).dq for t in np.linspace(0.0, stop.to_go_s, 9)[1:-1]]
    shares = [dq @ motion.dq / (np.linalg.norm(dq) * np.linalg.norm(motion.dq)) for dq in ends]
    assert min(shares) > 0.999


def test_the_check_weighs_what_stands_on_the_torso(cell, world):
    """The lift's holding force, by the physics, with both arms at `ready`."""
    (found,) = [f for f in carried(cell) if f.check == "torso.carrying ready"]
    world.q[:], world.dq[:] = posture(cell), 0.0
    mujoco.mj_forward(world.model, world.data)
    force = abs(world.data.qfrc_bias[1])
    assert found.values["share"] * 4000.0 == pytest.approx(force, rel=1e-3)
    assert force > 900.0


def test_an_arm_that_cannot_keep_up_slows_the_torso_and_the_other_arm(cell, world):
    """Both tools stay below a torso that is driven: all go at one share."""
    _, left, right = cell.parts
    slow = {f"mechanism.drives.{i}.max_velocity": 0.06 for i in range(7)}
    slowed = Control.of(replace(cell, others=(altered(left, slow), right)))
    ticks = list(led(cell, slowed, ticks=100, torso=stick(0.0, 0.0, 0.0, 0.0, 0.0, 0.2)))
    q, outputs, motion = ticks[-1]
    assert outputs[0].dq_asked[0] == pytest.approx(0.2, abs=1e-6)
    assert 0.01 < motion.dq[0] < 0.15
    assert "joint_speed" in outputs[1].limits
    for name in ("left", "right"):
        assert np.abs(true_jacobian(world, q, name)[0] @ motion.dq).max() < 2e-3


def test_a_torso_whose_own_axes_are_free_goes_where_objectives_lead_it_below_tools_that_stay(
    cell, world
):
    """All sixteen joints are redundant together: four freedoms that no task needs."""
    free = altered(cell, {"resolve.free_axes": ("z", "rz"), "redundancy.mid_range": 0.5})
    start = posture(cell)
    start[:2] = 0.4, 0.3
    ticks = list(led(free, Control.of(free), ticks=150, q=start))
    q, outputs, _ = ticks[-1]
    assert q[0] < 0.37
    assert q[1] < 0.26
    for name in ("left", "right"):
        J, at = true_jacobian(world, q, name)
        assert np.abs(J @ rates(outputs)).max() < 1e-9
        assert np.linalg.norm(at - true_jacobian(world, ticks[0][0], name)[1]) < 3e-4
