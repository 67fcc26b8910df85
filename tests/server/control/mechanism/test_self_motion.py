"""Self-motion by hand: rates against Jacobian and finite differences; direction and bounds."""

import math
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.arm import Arm
from telerobot.server.control.bodies.rates import ArmTick
from telerobot.server.control.inputs import Inputs, Intent, SelfMotionRequest
from telerobot.server.control.mechanism.self_motion import BOUNDED, IDLE, NONE_SPARE, SINGULAR
from telerobot.server.control.spatial import Motion, Pose
from telerobot.server.control.stop.limiter import Commanded

MRF = Pose.from_xyz_rpy((0.05, -0.02, 0.15), (0.3, -0.5, 0.7))
STEP = 1e-6


@cache
def arm_of(name):
    return Arm.of(load_cell(name))


def at_rate(rate):
    """A state whose shaped rate has come to be what is asked for."""
    return IDLE._replace(motion=Motion(np.zeros(1), np.array([rate]), np.zeros(1)))


def posture_of(name, rng):
    lower, upper = arm_of(name).p.joints.lower, arm_of(name).p.joints.upper
    return rng.uniform(np.maximum(lower, -1.2), np.minimum(upper, 1.2))


def answered(name, q, asked, before, **more):
    """What a request comes to at joints q, and the kinematics there."""
    arm = arm_of(name)
    k = arm.mechanism.kinematics(q, MRF)
    # The planar arm's task is its place alone.
    rows, rank = (k.J[:3], 2) if name == "planar3" else (k.J, arm.mechanism.rank)
    null = np.linalg.svd(rows)[2][rank:]
    dq, share = np.zeros(len(q)), more.pop("share", 1.0)
    dq = more.pop("dq", dq)
    factor = more.pop("factor", 1.0)
    return k, arm.body.by_hand.step(k, null, asked, before, dq, factor, share, **more)


@pytest.mark.parametrize("name", ["pa10", "ranger", "rover", "rover_bridge"])
def test_the_angle_changes_at_the_rate_and_the_tool_not_at_all(name):
    arm, rng, tried = arm_of(name), np.random.default_rng(2), 0
    reader = arm.mechanism.arm_angle
    while tried < 20:
        q = posture_of(name, rng)
        k, answer = answered(name, q, SelfMotionRequest(0.05), at_rate(0.05))
        if math.isnan(reader.look(k).angle) or answer.limits:
            continue
        tried += 1
        assert k.J @ answer.dq == pytest.approx(np.zeros(6), abs=1e-9)
        ends = [arm.mechanism.kinematics(q + d * answer.dq, MRF) for d in (STEP, -STEP)]
        change = reader.look(ends[0]).angle - reader.look(ends[1]).angle
        assert change / (2.0 * STEP) == pytest.approx(0.05, rel=1e-4)
        moved = [n for n, rate in zip(arm.p.joints.names, answer.dq, strict=True) if rate]
        assert not any(joint.startswith("wheel") for joint in moved)


def test_without_an_angle_the_middle_joint_turns_on_and_the_sign_is_kept():
    name, arm = "planar3", arm_of("planar3")
    q, before = np.array([0.1, 1.2, -1.0]), at_rate(0.5)
    _, answer = answered(name, q, SelfMotionRequest(0.5), before)
    assert answer.dq[1] > 0.0
    # at its bound of self-motion times the rate
    most = arm.p.redundancy.max_rate * arm.p.joints.velocity
    assert (np.abs(answer.dq) / most).max() == pytest.approx(0.5)
    last = answer.state.direction
    for _ in range(400):
        k, answer = answered(name, q, SelfMotionRequest(0.5), answer.state)
        assert k.J[:3] @ answer.dq == pytest.approx(np.zeros(3), abs=1e-9)
        assert answer.state.direction @ last > 0.99
        last, q = answer.state.direction, q + 0.02 * answer.dq


def test_an_angle_is_approached_by_the_shorter_way_no_faster_than_asked():
    q = np.array([0.0, 0.6, 0.4, 1.3, 0.2, 0.9, 0.0])
    at = arm_of("pa10").mechanism.arm_angle.look(arm_of("pa10").mechanism.kinematics(q, MRF)).angle
    for angle, left in ((at + 1.0, 1.0), (at - 1.0, -1.0), (at + 3.5, 3.5 - 2.0 * math.pi)):
        _, answer = answered("pa10", q, SelfMotionRequest(0.2, angle), at_rate(0.0))
        assert answer.state.left == pytest.approx(left)
        state = answer.state
        for _ in range(100):
            _, answer = answered("pa10", q, SelfMotionRequest(0.2, angle), state)
            state = answer.state
        assert float(state.motion.dq[0]) == pytest.approx(math.copysign(0.2, left))


def test_task_and_objectives_have_their_room_first_and_avoiding_takes_its_share():
    q = np.array([0.0, 0.6, 0.4, 1.3, 0.2, 0.9, 0.0])
    arm, asked = arm_of("pa10"), SelfMotionRequest(0.3)
    velocity = arm.p.joints.velocity
    _, free = answered("pa10", q, asked, at_rate(0.3))
    busy = 0.97 * velocity * np.sign(free.dq)
    _, answer = answered("pa10", q, asked, at_rate(0.3), dq=busy)
    assert answer.limits == (BOUNDED,)
    assert (np.abs(answer.dq + busy) / velocity).max() == pytest.approx(1.0)
    state = at_rate(0.3)
    for _ in range(100):
        _, answer = answered("pa10", q, asked, state, share=0.4)
        state = answer.state
    assert answer.dq == pytest.approx(0.4 * free.dq)


def test_a_stretched_elbow_and_an_arm_without_spare_joints_say_so():
    stretched = np.array([0.3, 0.7, 0.2, 0.0, 0.1, 0.4, 0.0])
    _, answer = answered("pa10", stretched, SelfMotionRequest(0.3), at_rate(0.3))
    assert answer.limits == (SINGULAR,)
    # Fifth and seventh joint in line: of all spare motions one is known, and it turns no elbow.
    aligned = np.array([0.0, -math.pi / 4, 0.0, math.pi / 2, 0.0, 0.0, 0.0])
    _, answer = answered("pa10", aligned, SelfMotionRequest(0.3), at_rate(0.3))
    assert answer.limits == (SINGULAR,)
    _, answer = answered("ur5e", np.full(6, 0.5), SelfMotionRequest(0.3), at_rate(0.0))
    assert answer.limits == (NONE_SPARE,)
    assert not answer.dq.any()
    assert [arm_of(n).body.spare(None, None) for n in ("pa10", "ur5e", "ranger")] == [1, 0, 2]


def test_the_more_avoiding_comes_first_the_less_an_operator_moves_the_spare_joints(pa10):
    """By the body: of the rate there is left what priority leaves of a hand's force, too."""
    arm, q = arm_of("pa10"), np.array([0.0, 0.6, 0.4, 1.3, 0.2, 0.9, 0.0])
    k = arm.mechanism.kinematics(q, pa10.settings.T_wrist_mrf)
    inputs = Inputs(
        0.0, Intent.MOVE, q, pa10.settings, at_posture=True, self_motion=SelfMotionRequest(0.1)
    )

    def rate(near):
        told = Commanded.at_rest(q)
        state = at_rate(0.1)
        for _ in range(100):
            request = ArmTick(
                inputs, k, k.T_world_wrist, np.zeros(7), told, near=near, by_hand=state,
                settled=True,
            )  # fmt: skip
            request.objectives = arm.redundancy.objectives
            state = arm.body.rates(request).by_hand
        return float(state.motion.dq[0])

    assert rate(None) == pytest.approx(0.1)
    for alpha in (0.0, 0.2, 0.8, 1.0):
        assert rate(SimpleNamespace(alpha=alpha)) == pytest.approx(0.1 * (1.0 - alpha), abs=1e-9)
