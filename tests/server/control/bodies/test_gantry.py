"""An arm on a gantry: its law by numpy, and that the arm answers what the gantry is driven at."""

import numpy as np
import pytest
from telerobot.config.load import ConfigError, altered, load_cell
from telerobot.protocols.messages.messages import Drive
from telerobot.server.commands.commands import drive_commands
from telerobot.server.control.arm import Arm
from telerobot.server.control.axes import HeldAxes, holding
from telerobot.server.control.bodies.rates import ArmTick
from telerobot.server.control.inputs import DriveRequest, Inputs, Intent, Settings
from telerobot.server.control.spatial import Pose
from telerobot.server.control.stop.limiter import Commanded
from telerobot.server.refusals import Refused
from telerobot.server.telemetry import describe
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

BENT = np.array([-0.4, 0.1, 0.2, 3.0, -1.6, 1.7, 0.1, 1.4, -1.4])
WEIGHT = 2.0


@pytest.fixture(scope="module")
def cell():
    return load_cell("gantry")


@pytest.fixture(scope="module")
def arm(cell):
    return Arm.of(cell)


@pytest.fixture
def rates(arm):
    k = arm.mechanism.kinematics(BENT, arm.p.T_wrist_tool)

    def found(twist, held=None, **more):
        settings = Settings({}, arm.p.T_wrist_tool, Pose.identity(), np.zeros(6))
        inputs = Inputs(0.0, Intent.MOVE, BENT, settings, **more)
        told = Commanded.at_rest(BENT)
        request = ArmTick(inputs, k, k.T_world_wrist, np.zeros(9), told, held=held)
        request.objectives, request.asked = arm.redundancy.objectives, np.array(twist)
        return k.J, arm.body.rates(request)

    return found


@pytest.mark.parametrize("ground", ["world", "base"])
def test_the_rails_share_the_work_of_a_tool_by_their_weight(rates, ground):
    """Zhang 2013, eqs. 7 and 8, weighted. Base stands: relative to it is in World."""
    twist = np.array([0.1, -0.05, 0.03, 0.1, 0.0, -0.2])
    J, found = rates(twist, ground=ground)
    D = np.diag([WEIGHT] * 3 + [1.0] * 6)
    task = found.dq - found.self_motion.dq
    assert task == pytest.approx(D @ np.linalg.pinv(J @ D) @ twist, abs=1e-9)
    assert J @ found.dq == pytest.approx(twist, abs=1e-12)


def test_rails_make_up_for_nothing_along_an_axis_that_the_task_leaves_free(rates, arm):
    """Driven, while the tool is asked to turn about an axis that is free: the arm is not short."""
    k = arm.mechanism.kinematics(BENT, arm.p.T_wrist_tool)
    axes = HeldAxes.of(holding(("rz",)), k.T_world_mrf.R, (5, 5))
    twist = np.array([0.0, 0.02, 0.0, *(0.5 * k.T_world_mrf.R[:, 2])])
    J, found = rates(twist, drive=DriveRequest(0.2, turn=-0.1), held=axes)
    assert found.dq[:3] == pytest.approx([0.2, -0.1, 0.0], abs=1e-12)
    assert axes.part(J @ found.dq) == pytest.approx(axes.part(twist), abs=1e-9)
    assert "singularity" not in found.limits


def test_rails_that_are_driven_go_as_told_and_the_arm_keeps_the_tool_in_world(rates):
    twist = np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.1])
    J, found = rates(twist, drive=DriveRequest(0.2, turn=-0.1))
    assert found.dq[:3] == pytest.approx([0.2, -0.1, 0.0], abs=1e-12)
    assert J @ found.dq == pytest.approx(twist, abs=1e-9)
    assert not found.wheels_commanded


def test_a_drive_beyond_the_rails_own_speeds_is_slowed_in_proportion(arm):
    driven = arm.body.driven(DriveRequest(3.0, turn=1.5), 0.5)
    assert driven == pytest.approx([0.3, 0.15, 0.0])


def test_a_posture_is_the_rails_too_unless_they_are_driven(arm):
    towards = np.arange(9.0)
    assert arm.body.with_drive(towards, DriveRequest(), 1.0) == pytest.approx(towards)
    driven = arm.body.with_drive(towards, DriveRequest(0.1), 1.0)
    assert driven == pytest.approx([0.1, 0.0, 0.0, *towards[3:]])


def test_joints_that_do_not_come_first_or_turn_are_no_rails(tmp_path):
    """Told when the cell is read, so that `check` says it, too."""
    path = tmp_path / "cell.toml"
    path.write_text('extends = "gantry"\n[mechanism.gantry]\njoints = ["y", "x"]\n')
    with pytest.raises(ConfigError, match=r"gantry.joints: value y, x: the chain begins with x, y"):
        load_cell(path)
    path.write_text('extends = "ur5e"\n[mechanism.gantry]\njoints = ["pan"]\n')
    with pytest.raises(ConfigError, match=r"gantry.joints: pan is revolute, prismatic is expected"):
        load_cell(path)


def test_rails_are_the_first_of_the_chain_whatever_the_order_of_the_drives(tmp_path, cell):
    text = cell.path.read_text()
    head, *drives = text.split("[[mechanism.drives]]")
    swapped = [head, drives[1], drives[0], *drives[2:]]
    path = tmp_path / "cell.toml"
    path.write_text("[[mechanism.drives]]".join(swapped))
    names = [drive.joint for drive in load_cell(path).config.mechanism.drives]
    assert names[:3] == ["x", "y", "z"]


@pytest.mark.parametrize(
    ("joints", "rates", "words"),
    [
        (("x", "y", "z"), [0.41, 0.0], r"rates\[0\]: 0.41 m/s: at most 0.4"),
        (("x", "y", "z"), [0.0, -0.5], r"rates\[1\]: -0.5 m/s: at most 0.4"),
        (("x",), [0.1, 0.1], r"rates\[1\]: 0.1 m/s: at most 0 "),
    ],
)
def test_a_drive_that_the_rails_cannot_do_is_refused_with_its_bound(cell, joints, rates, words):
    told = drive_commands(altered(cell, {"mechanism.gantry.joints": joints}))
    with pytest.raises(Refused, match=words):
        told.take(Drive(seen_tick=0, rates=rates), 0.0, Pose.identity())


def test_driven_on_at_the_rails_end_it_stops_there_and_the_tool_stays(cell):
    near = (1.2, *cell.config.mechanism.postures["ready"][1:])
    cell = altered(cell, {"mechanism.postures.start": near})
    steps = [{"at_s": 0.2, "cmd/drive": {"rates": [0.4, 0.0]}}]
    simulation = Simulation(cell, Script.model_validate({"duration_s": 3.0, "step": steps}))
    result = simulation.run()
    rail = np.array([truth.q[0] for truth in result.truths])
    tool = np.array([truth.pose_mrf[:3] for truth in result.truths])
    assert result.summary["mode"] == "enabled"
    assert 1.3 < rail.max() <= 1.49 + 1e-4  # its limit less the drive's margin
    assert np.linalg.norm(tool - tool[0], axis=1).max() < 0.01
    assert result.summary["limit_violations"] == 0


def test_driven_on_past_its_arms_reach_it_stops_and_nothing_else_of_the_gantry_goes(cell):
    steps = [{"at_s": 0.2, "cmd/drive": {"rates": [0.4, 0.0]}}]
    result = Simulation(cell, Script.model_validate({"duration_s": 4.5, "step": steps})).run()
    rails = np.array([truth.q[:3] for truth in result.truths])
    tool = np.array([truth.pose_mrf[:3] for truth in result.truths])
    assert np.ptp(rails[:, 0]) > 0.9
    assert np.ptp(rails[-50:, 0]) < 1e-3
    assert np.abs(rails[:, 1:] - rails[0, 1:]).max() < 1e-3
    assert np.linalg.norm(tool - tool[0], axis=1).max() < 0.02


def test_led_far_along_the_tool_does_not_overshoot_and_stays_while_the_rails_go_below():
    """The shipped script: 1.8 m, then 0.15 and 0.1 m/s under a tool that stays."""
    simulation = Simulation(load_cell("gantry"), load_script("reach_along"))
    result = simulation.run()
    assert result.ok
    states = result.states[-len(result.truths) :]
    goal = np.array(next(s.target_mrf for s in reversed(states) if s.target_mrf)[:3])
    off = np.linalg.norm([np.array(t.pose_mrf[:3]) - goal for t in result.truths], axis=1)
    there = int(np.argmax([state.at_goal for state in states]))
    rails = np.array([truth.q[:3] for truth in result.truths])
    assert np.ptp(rails[:there, 0]) > 1.4
    assert np.linalg.norm(rails[-1] - rails[there]) > 0.2
    assert off[there:].max() < 0.004


def test_operators_are_told_which_joints_slide_and_how_fast_the_rails_may_be_driven(cell):
    told = describe(cell)
    assert told.slides == (True,) * 3 + (False,) * 6
    assert told.base == {"speed": 0.4, "angular_speed": 0.4}
    assert describe(load_cell("ur5e")).slides == ()
