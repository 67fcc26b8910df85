import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema import cell as schema
from telerobot.protocols.messages import messages as m
from telerobot.protocols.messages import requests
from telerobot.protocols.messages.messages import PathMotion
from telerobot.protocols.messages.perception import FrameRequest
from telerobot.server.commands.commands import Commands
from telerobot.server.control.scene import Mount
from telerobot.server.control.spatial import Pose, rotation_rpy
from telerobot.server.refusals import Refused, Why

ENVELOPE = {"seen_tick": 1}
BASE = Pose.from_xyz_rpy((1.0, 2.0, 0.5), (0.0, 0.0, np.pi / 2))
CRF = Pose.from_xyz_rpy((0.3, -0.2, 0.1), (np.pi / 2, 0.0, 0.0))
MRF = Pose.from_xyz_rpy((0.7, 0.1, 0.4), (0.2, -0.5, 1.1))
LENS = Pose.from_xyz_rpy((-0.1, 0.2, 0.0), (0.3, 0.0, -1.0))
TOOL = Pose.from_xyz_rpy((0.0, 0.0, 0.121), (0.0, 0.0, 0.0))
WRIST = MRF @ TOOL.inverse()
ORIGINS = {
    m.Frame.WORLD: Pose.identity(),
    m.Frame.BASE: BASE,
    m.Frame.CRF: CRF,
    m.Frame.MRF: MRF,
    m.Frame.CARRIER: Pose.identity(),
    m.Frame.WRIST: WRIST,
    m.Frame.SENSOR: WRIST,
    m.Frame.LENS: WRIST @ LENS,
}


def schema_pose(T):
    x, y, z, *rpy = T.to_xyz_rpy()
    return schema.PoseSection(xyz=(x, y, z), rpy=tuple(rpy))


@pytest.fixture
def commands(pa10):
    """The PA-10's orders, with Base, CRF and MRF each somewhere else."""
    commands = Commands.from_cell(
        altered(
            pa10.cell,
            {"mechanism.T_world_base": schema_pose(BASE), "T_world_crf": schema_pose(CRF)},
        )
    )
    commands.frames.lens = lambda: Mount("wrist", LENS)
    # With force control off, the MRF may be anywhere on a tool.
    commands.settings.switch("force", False)
    return commands


def take(commands, kind, now_s=0.0, **fields):
    commands.take(kind(**ENVELOPE, **fields), now_s, MRF)
    return commands


def refusal(commands, kind, **fields):
    with pytest.raises(Refused) as caught:
        take(commands, kind, **fields)
    return caught.value


def target(commands):
    return commands.goals.goal.T_world_target


# --- frames ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("relative_to", m.Frame)
@pytest.mark.parametrize("expressed_in", m.Frame)
def test_a_target_is_measured_from_one_frame_in_the_axes_of_another(
    commands, relative_to, expressed_in
):
    xyz, rpy = (0.1, -0.2, 0.3), (0.3, 0.2, -0.4)
    take(
        commands,
        m.PositionTarget,
        xyz=xyz,
        rpy=rpy,
        relative_to=relative_to,
        expressed_in=expressed_in,
    )
    origin, axes = ORIGINS[relative_to], ORIGINS[expressed_in].R
    np.testing.assert_allclose(axes.T @ (target(commands).p - origin.p), xyz, atol=1e-12)
    # The turn leads from the origin's attitude, about the axes named.
    turn = target(commands).R @ origin.R.T
    np.testing.assert_allclose(axes.T @ turn @ axes, rotation_rpy(*rpy), atol=1e-12)


@pytest.mark.parametrize("frame", m.Frame)
def test_without_other_axes_a_target_is_a_pose_in_its_frame(commands, frame):
    xyz, rpy = (0.1, -0.2, 0.3), (0.3, 0.2, -0.4)
    take(commands, m.PositionTarget, xyz=xyz, rpy=rpy, relative_to=frame)
    expected = ORIGINS[frame] @ Pose.from_xyz_rpy(xyz, rpy)
    np.testing.assert_allclose(target(commands).p, expected.p, atol=1e-12)
    np.testing.assert_allclose(target(commands).R, expected.R, atol=1e-12)


def test_a_target_relative_to_the_mrf_is_a_displacement_from_where_it_is(commands):
    take(commands, m.PositionTarget, xyz=(0, 0, 0), rpy=(0, 0, 0), relative_to="mrf")
    np.testing.assert_allclose(target(commands).p, MRF.p, atol=1e-12)
    np.testing.assert_allclose(target(commands).R, MRF.R, atol=1e-12)


def test_a_target_is_relative_to_the_crf_when_nothing_else_is_said(commands):
    take(commands, m.PositionTarget, xyz=(0, 0, 0), rpy=(0, 0, 0))
    np.testing.assert_allclose(target(commands).p, CRF.p, atol=1e-12)


@pytest.mark.parametrize("frame", m.Frame)
def test_the_sticks_axes_are_those_of_the_frame_it_names(commands, frame):
    twist = (0.1, 0, 0, 0, 0, 0.2)
    take(commands, m.JoystickTwist, twist=twist, expressed_in=frame)
    command = commands.in_force(0.0, lambda: MRF).stick
    np.testing.assert_array_equal(command.twist, twist)
    np.testing.assert_allclose(command.R_world_axes, ORIGINS[frame].R, atol=1e-12)


def test_a_stick_in_mrf_axes_turns_with_the_tool(commands):
    take(commands, m.JoystickTwist, twist=(0.1, 0, 0, 0, 0, 0), expressed_in="mrf")
    turned = Pose(rotation_rpy(1.0, 0.0, 0.0), MRF.p)
    np.testing.assert_array_equal(
        commands.in_force(0.0, lambda: turned).stick.R_world_axes, turned.R
    )


def test_a_target_stays_where_it_is_for_the_wrist_whatever_frame_is_redefined(commands):
    pose = {"xyz": (0.0, 0.0, 0.2), "rpy": (0.0, 0.0, 0.5)}
    take(commands, m.PositionTarget, xyz=(0, 0, 0), rpy=(0, 0, 0))
    wrist = commands.target @ commands.frames.T_wrist_mrf.inverse()
    commands.set_frame(FrameRequest(**ENVELOPE, frame="crf", **pose), MRF)
    np.testing.assert_allclose(commands.settings.for_control().T_world_crf.p, pose["xyz"])
    goal = commands.goals.goal
    commands.set_frame(FrameRequest(**ENVELOPE, frame="mrf", **pose), MRF)
    expected = Pose.from_xyz_rpy(pose["xyz"], pose["rpy"])
    np.testing.assert_array_equal(commands.settings.for_control().T_wrist_mrf.R, expected.R)
    kept = commands.target @ commands.frames.T_wrist_mrf.inverse()
    np.testing.assert_allclose(kept.p, wrist.p, atol=1e-12)
    np.testing.assert_allclose(kept.R, wrist.R, atol=1e-12)
    # The path goes on as it was: it leads the point of the tool that it was ordered for.
    assert commands.goals.goal is goal
    np.testing.assert_array_equal(commands.goals.T_wrist_goal.p, TOOL.p)


def test_timed_twists_go_on_when_the_mrf_is_another(commands):
    take(commands, PathMotion, twists=((0.1, 0, 0, 0, 0, 0),), durations_s=(1.0,))
    goal = commands.goals.goal
    commands.set_frame(FrameRequest(**ENVELOPE, frame="mrf", xyz=(0.0, 0.0, 0.2)), MRF)
    assert commands.goals.goal is goal
    np.testing.assert_array_equal(commands.goals.T_wrist_goal.p, TOOL.p)
    take(commands, m.PositionTarget, xyz=(0, 0, 0), rpy=(0, 0, 0))
    np.testing.assert_array_equal(commands.goals.T_wrist_goal.p, [0.0, 0.0, 0.2])


@pytest.mark.parametrize("frame", ["mrf", "crf"])
@pytest.mark.parametrize("axes", ["mrf", "crf", "world", "base"])
def test_a_desired_wrench_stays_the_same_load_whatever_frame_is_redefined(commands, frame, axes):
    """A force along the CRF's z does not push sideways because the CRF turned."""
    take(commands, m.DesiredWrench, wrench=(8.0, -3.0, 5.0, 0.4, 0.0, -0.2), expressed_in=axes)

    def load(T_world_mrf):
        """Return the desired force and its moment about World's origin, in World axes."""
        R = commands.in_force(0.0, lambda: T_world_mrf).R_world_wrench
        R = T_world_mrf.R if R is None else R
        f, moment = R @ commands.wrench.value[:3], R @ commands.wrench.value[3:]
        return np.concatenate([f, moment + np.cross(T_world_mrf.p, f)])

    before, pose = load(MRF), {"xyz": (0.1, -0.2, 0.3), "rpy": (0.4, -0.8, 1.5)}
    commands.set_frame(FrameRequest(**ENVELOPE, frame=frame, **pose), MRF)
    np.testing.assert_allclose(load(WRIST @ commands.frames.T_wrist_mrf), before, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        (m.PositionTarget, {"xyz": (0, 0, 0), "rpy": (0, 0, 0), "relative_to": "lens"}),
        (m.JoystickTwist, {"twist": (0.1,) * 6, "expressed_in": "lens"}),
        (m.DesiredWrench, {"wrench": (1.0,) * 6, "expressed_in": "lens"}),
        (PathMotion, {"twists": ((0.1,) * 6,), "durations_s": (1.0,), "expressed_in": "lens"}),
    ],
)
def test_a_frame_that_the_cell_lacks_is_refused_with_those_that_it_has(commands, kind, fields):
    commands.frames.lens = lambda: None
    refused = refusal(commands, kind, **fields)
    assert refused.reason == Why.UNKNOWN_FRAME
    assert "world, base, carrier, crf, wrist, mrf, sensor" in refused.detail
    assert commands.goals.goal is None
    assert commands.in_force(0.0, lambda: MRF).stick is None


# --- streams --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["joystick", "jog"])
def test_a_stream_is_true_until_its_news_is_too_old(commands, name, pa10):
    kind, fields, read = {
        "joystick": (
            m.JoystickTwist,
            {"twist": (0.1,) * 6},
            lambda t: commands.in_force(t, lambda: MRF).stick,
        ),
        "jog": (m.JointJog, {"rates": (0.1,) * 7}, lambda t: commands.in_force(t, lambda: MRF).jog),
    }[name]
    timeout = pa10.cell.config.timing.stream_timeout_s
    take(commands, kind, now_s=10.0, **fields)
    assert read(10.0 + timeout - 1e-6) is not None
    assert commands.expired(10.0 + timeout - 1e-6) == []
    assert read(10.0 + timeout + 1e-6) is None
    assert commands.expired(10.0 + timeout + 1e-6) == [name]
    assert commands.expired(10.0 + timeout + 1.0) == []
    take(commands, kind, now_s=20.0, **fields)
    assert read(20.1) is not None


def test_a_stick_at_rest_falls_silent_without_a_word(commands):
    take(commands, m.JoystickTwist, twist=(0.0,) * 6)
    assert commands.expired(10.0) == []
    assert commands.in_force(10.0, lambda: MRF).stick is None


# --- goals ----------------------------------------------------------------------------------------

POSE = {"xyz": (0.1, 0.2, 0.3), "rpy": (0.0, 0.0, 0.0)}


def test_goals_stay_however_old(commands):
    take(commands, m.PositionTarget, **POSE)
    take(commands, m.DesiredWrench, wrench=(1, 2, 3, 0, 0, 0))
    commands.expired(1e6)
    assert commands.goals.goal is not None
    np.testing.assert_array_equal(commands.wrench.value, (1, 2, 3, 0, 0, 0))


def test_the_newest_goal_is_the_only_one(commands):
    take(commands, m.PositionTarget, **POSE)
    first = commands.goals.goal
    take(commands, m.PositionTarget, **POSE, speed=0.05)
    assert commands.goals.goal.serial > first.serial
    assert commands.goals.goal.speed == 0.05
    take(commands, m.PostureMove, posture="ready")
    assert commands.goals.goal is None
    assert commands.goals.posture is not None
    take(commands, m.PositionTarget, **POSE)
    assert commands.goals.posture is None
    take(commands, m.JointJog, rates=(0.1,) * 7)
    assert commands.goals.goal is None


def test_a_stick_that_moves_ends_a_posture_and_never_a_target(commands):
    take(commands, m.PostureMove, posture="ready")
    take(commands, m.JoystickTwist, twist=(0.0,) * 6)
    assert commands.goals.posture is not None
    take(commands, m.JoystickTwist, twist=(0.1, 0, 0, 0, 0, 0))
    assert commands.goals.posture is None
    take(commands, m.PositionTarget, **POSE)
    take(commands, m.JoystickTwist, twist=(0.1, 0, 0, 0, 0, 0))
    assert commands.goals.goal is not None


@pytest.mark.parametrize(
    ("message", "fields", "key"),
    [
        (m.JoystickTwist, {"twist": (0.1, 0, 0, 0, 0, 0)}, "cmd/joystick"),
        (m.JointJog, {"rates": (0.1, 0, 0, 0, 0, 0, 0)}, "cmd/jog"),
        (m.PositionTarget, POSE, "cmd/position"),
    ],
)
def test_a_posture_that_is_dropped_for_something_else_is_told(commands, message, fields, key):
    take(commands, m.PostureMove, posture="ready")
    assert commands.dropped == []
    take(commands, message, **fields)
    assert commands.dropped == [("posture", key)]


def test_a_goal_that_a_jog_drops_is_told_and_what_is_cancelled_or_replaced_is_not(commands):
    take(commands, m.PositionTarget, **POSE)
    take(commands, m.PositionTarget, **POSE)
    take(commands, m.CancelGoals)
    take(commands, m.PostureMove, posture="ready")
    take(commands, m.JoystickTwist, twist=(0.0,) * 6)
    take(commands, m.CancelGoals)
    assert commands.dropped == []
    take(commands, m.PositionTarget, **POSE)
    take(commands, m.JointJog, rates=(0.1, 0, 0, 0, 0, 0, 0))
    assert commands.dropped == [("goal", "cmd/jog")]


def test_nothing_is_asked_of_an_arm_until_a_command_asks_for_motion(commands):
    commands.clear()
    take(commands, m.JoystickTwist, twist=(0.0,) * 6)
    take(commands, m.JointJog, rates=(0.0,) * 7)
    take(commands, m.CancelGoals)
    assert commands.goals.at_rest
    take(commands, m.JoystickTwist, twist=(0.1, 0, 0, 0, 0, 0))
    assert not commands.goals.at_rest
    commands.clear()
    assert commands.goals.at_rest


def test_a_posture_that_is_reached_gives_way_and_is_said_to_be_until_the_next_goal(commands):
    take(commands, m.PostureMove, posture="ready")
    commands.goals.finish_posture()
    assert commands.goals.posture is None
    assert commands.goals.posture_reached
    take(commands, m.PositionTarget, **POSE)
    assert not commands.goals.posture_reached


def test_cancel_drops_every_goal_and_clear_the_streams_as_well(commands):
    def order_everything():
        take(commands, m.PositionTarget, **POSE)
        take(commands, m.DesiredWrench, wrench=(1, 2, 3, 0, 0, 0))
        take(commands, m.JoystickTwist, twist=(0.1,) * 6)

    order_everything()
    take(commands, m.CancelGoals)
    assert commands.goals.goal is None
    assert not commands.wrench.value.any()
    assert commands.in_force(0.0, lambda: MRF).stick is not None
    order_everything()
    take(commands, m.PostureMove, q=(0.1,) * 7)
    commands.clear()
    assert (
        commands.goals.goal
        is commands.goals.posture
        is commands.in_force(0.0, lambda: MRF).stick
        is commands.in_force(0.0, lambda: MRF).jog
        is None
    )
    assert not commands.wrench.value.any()


def test_a_path_that_is_begun_anew_leads_to_the_same_target(commands):
    commands.goals.restart_path()
    assert commands.goals.goal is None
    take(commands, m.PositionTarget, **POSE)
    before = commands.goals.goal
    commands.goals.restart_path()
    assert commands.goals.goal.attempt > before.attempt
    assert commands.goals.goal.T_world_target is before.T_world_target


# --- what does not fit the cell -------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "field"), [(m.JointJog, "rates"), (m.PostureMove, "q")])
@pytest.mark.parametrize("count", [1, 6, 8])
def test_as_many_numbers_as_joints_or_none(commands, kind, field, count):
    refused = refusal(commands, kind, **{field: (0.0,) * count})
    assert refused.reason == Why.WRONG_JOINTS
    assert f"{count} values for 7 joints" in refused.detail


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_jog_faster_than_a_joint_is_refused_with_joint_value_and_bound(commands, pa10, sign):
    rates = np.zeros(7)
    rates[3] = sign * pa10.p.joints.velocity[3]
    take(commands, m.JointJog, rates=tuple(rates))
    refused = refusal(commands, m.JointJog, rates=tuple(1.001 * rates))
    assert refused.reason == Why.OUT_OF_RANGE
    assert "e1" in refused.detail
    assert "1.8" in refused.detail
    np.testing.assert_array_equal(commands.in_force(0.0, lambda: MRF).jog, rates)


@pytest.mark.parametrize("bound", ["lower", "upper"])
def test_a_posture_beyond_a_limit_is_refused_and_the_goal_before_it_stays(commands, pa10, bound):
    limit = getattr(pa10.p.joints, bound)
    q = np.zeros(7)
    q[1] = limit[1]
    take(commands, m.PostureMove, q=tuple(q))
    q[1] += np.copysign(1e-6, limit[1])
    refused = refusal(commands, m.PostureMove, q=tuple(q))
    assert refused.reason == Why.OUT_OF_RANGE
    assert "s2" in refused.detail
    assert commands.goals.posture[1] == limit[1]


def test_an_unknown_posture_is_refused_with_those_there_are(commands):
    refused = refusal(commands, m.PostureMove, posture="reday")
    assert refused.reason == Why.UNKNOWN_POSTURE
    assert "ready" in refused.detail


def test_every_posture_of_the_cell_can_be_ordered(arm):
    commands = Commands.from_cell(arm.cell)
    for name, q in arm.cell.config.mechanism.postures.items():
        take(commands, m.PostureMove, posture=name)
        np.testing.assert_array_equal(commands.goals.posture, q)


# --- settings -------------------------------------------------------------------------------------


def test_a_source_that_is_off_has_no_gain_and_gets_back_its_own(commands):
    commands.settings.switch("force", True)
    own = commands.settings.for_control().gains["force"]
    assert own.all()
    commands.settings.on["force"] = False
    assert not commands.settings.for_control().gains["force"].any()
    commands.settings.on["force"] = True
    np.testing.assert_array_equal(commands.settings.for_control().gains["force"], own)


def test_a_payload_is_switched_by_the_name_that_the_cell_gives_it(small):
    block = "\n[mechanism.payloads]\nempty = { mass = 0.4 }\n\n[mechanism.force_torque]"
    cell = load_cell(small.replace("\n[mechanism.force_torque]", block))
    commands = Commands.from_cell(cell)
    assert commands.settings.for_control().payload.mass == 0.0
    envelope = {"seen_tick": 0}
    commands.settings.set_payload(requests.PayloadRequest(**envelope, name="empty"))
    assert commands.settings.for_control().payload.mass == 0.4


def test_a_cell_without_a_sensor_takes_no_payload(small):
    bare = small.replace("[mechanism.force_torque]\nrate_hz = 200", "")
    commands = Commands.from_cell(load_cell(bare))
    envelope = {"seen_tick": 0}
    with pytest.raises(Refused) as refused:
        commands.settings.set_payload(requests.PayloadRequest(**envelope, mass=1.0))
    assert refused.value.reason == Why.NOT_NOW


def test_the_bias_of_the_cell_file_is_the_sensors_and_turned_to_what_the_arm_exerts(commands, pa10):
    bias = pa10.cell.config.mechanism.force_torque.bias
    np.testing.assert_array_equal(commands.settings.for_control().wrench_bias, -np.array(bias))
