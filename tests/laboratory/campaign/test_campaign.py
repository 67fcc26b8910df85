"""A seeded sample of the campaign, and its judges against cases that are known."""

import json
import math

import numpy as np
import pytest
from laboratory.campaign.cli import main
from laboratory.campaign.hostile.generator import generate
from laboratory.campaign.hostile.report import Report
from laboratory.campaign.hostile.verdict import verdict
from laboratory.campaign.parts import PARTS
from laboratory.oracle.arm import OracleArm
from laboratory.oracle.feasible import GoalJudge
from laboratory.oracle.poses import difference, rotation, rotation_vector
from telerobot.config.load import load_cell

SAMPLE = [("pa10", 0), ("ur5e", 0), ("pa10", 1), ("ur5e", 1), ("pa10_vision", 1), ("ur5e", 2)]


@pytest.fixture(scope="module")
def verdicts():
    return [verdict(cell, seed) for cell, seed in SAMPLE]


def test_no_run_of_the_sample_violates_a_limit_or_faults_by_itself(verdicts):
    for v in verdicts:
        assert v.limit_violations == 0, (v.cell, v.seed, v.violations)
        assert v.unexpected == (), (v.cell, v.seed)
        assert v.failure == "", (v.cell, v.seed)


def test_an_arm_that_hit_itself_is_excused_by_the_physics_and_not_by_a_model_of_it():
    """Forearm on shoulder, a kilonewton, where the model's balls still see a centimetre."""
    v = verdict("ur5e", 44)
    assert v.touched
    assert v.unexpected == ()


def test_feasible_goals_of_the_sample_are_reached(verdicts):
    counted = [v for v in verdicts if v.counts]
    assert counted
    for v in counted:
        assert v.reached, (v.cell, v.seed, v.goal, v.error)


def test_the_sample_is_hostile(verdicts):
    assert Report(verdicts).limited_share > 0.2


def test_equal_seeds_give_equal_runs_and_others_do_not():
    pa10 = load_cell("pa10")
    first, again, other = generate(pa10, 7), generate(pa10, 7), generate(pa10, 8)
    assert first.script == again.script
    assert (first.scene, first.goal.kind) == (again.scene, again.goal.kind)
    assert (first.goal.T_target == again.goal.T_target).all()
    assert first.script != other.script


def test_scripts_end_in_a_goal_with_time_to_reach_it():
    for cell in (load_cell("pa10"), load_cell("ur5e")):
        for seed in range(12):
            plan = generate(cell, seed)
            last = plan.script.steps[-1]
            assert plan.goal.at_s <= last.at_s < plan.script.duration_s - 2.0
            assert plan.script.duration_s < 25.0


# --- the judges --------------------------------------------------------------------------------


def displaced(judge, q, xyz, turn=(0.0, 0.0, 0.0)):
    T = judge.arm.tool(q).copy()
    T[:3, 3] += xyz
    T[:3, :3] = rotation(np.array(turn)) @ T[:3, :3]
    return T


@pytest.mark.parametrize("name", ["pa10", "ur5e"])
def test_a_target_nearby_is_feasible_and_one_out_of_reach_is_not(name):
    judge = GoalJudge.of(load_cell(name))
    q = np.array(load_cell(name).config.mechanism.postures["ready"])
    assert judge.target(q, displaced(judge, q, [-0.05, 0.05, 0.05], [0.0, 0.1, 0.1])) == ""
    assert judge.target(q, displaced(judge, q, [0.0, 0.0, 3.0])) != ""


def test_a_target_in_the_table_or_behind_the_wall_is_a_collision():
    cell = load_cell("pa10")
    judge = GoalJudge.of(cell)
    q = np.array(cell.config.mechanism.postures["ready"])
    assert judge.target(q, displaced(judge, q, [0.12, 0.0, 0.0])) == "collision"
    assert judge.target(q, displaced(judge, q, [0.0, 0.0, -0.22])) == "collision"


def test_a_posture_near_its_limit_is_not_feasible():
    cell = load_cell("pa10")
    judge = GoalJudge.of(cell)
    q = np.array(cell.config.mechanism.postures["ready"])
    assert judge.posture(q) == ""
    q[5] = cell.robot.joints[5].upper - cell.config.mechanism.drives[5].position_margin - 0.01
    assert judge.posture(q) == "joint limit"


def test_the_judges_jacobian_is_that_of_a_planar_arm(small):
    # Two links of 0.4 m and 0.3 m in a vertical plane, on a turning column of 0.4 + 0.4 m.
    judge = GoalJudge.of(load_cell(small.cell))
    a, b = 0.5, 0.8
    tool = judge.arm.tool(np.array([0.0, a, b]))
    assert tool[:3, 3] == pytest.approx(
        [
            0.4 * math.sin(a) + 0.3 * math.sin(a + b),
            0.0,
            0.8 + 0.4 * math.cos(a) + 0.3 * math.cos(a + b),
        ]
    )
    J = judge.arm.jacobian(np.array([0.0, a, b]))
    assert J[:, 2] == pytest.approx(
        [0.3 * math.cos(a + b), 0.0, -0.3 * math.sin(a + b), 0.0, 1.0, 0.0], abs=1e-8
    )


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.0, math.pi - 1e-6])
def test_a_rotation_vector_survives_the_way_there_and_back(angle):
    vector = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    assert rotation_vector(rotation(vector)) == pytest.approx(vector, abs=1e-9)


def test_clearance_is_that_of_the_tool_from_the_wall():
    cell = load_cell("pa10")
    q = np.array(cell.config.mechanism.postures["ready"])
    things, own = OracleArm.of(cell).clearance(q)
    # The tool's ball of 12 mm, 0.10 m short of the wall's face.
    assert things == pytest.approx(0.10 - 0.012, abs=1e-3)
    assert own > 0.05


def test_difference_leads_from_one_pose_to_the_other():
    arm = OracleArm.of(load_cell("ur5e"))
    first, second = arm.tool(np.full(6, 0.3)), arm.tool(np.full(6, 0.5))
    twist = difference(second, first)
    assert first[:3, 3] + twist[:3] == pytest.approx(second[:3, 3])
    assert rotation(twist[3:]) @ first[:3, :3] == pytest.approx(second[:3, :3])


# --- the report and the command ----------------------------------------------------------------


def test_a_campaign_without_a_reached_goal_breaks_its_promise():
    report = Report([])
    assert not report.kept
    assert report.promises["no_limit_violated"]


def test_an_unknown_part_is_bad_usage_and_the_parts_are_named(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--only", "hostil"])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert all(f"'{name}'" in said for name in ("hostil", *PARTS))


def test_a_part_is_played_and_its_figures_stand_under_its_name(tmp_path, capsys):
    out = tmp_path / "figures.json"
    arguments = ["--only", "hostile", "--cells", "ur5e", "--seeds", "0:1", "--jobs", "1"]
    code = main([*arguments, "--json", str(out)])
    figures = json.loads(out.read_text())
    assert list(figures) == ["hostile"]
    assert figures["hostile"]["runs"] == 1
    assert code == (0 if all(figures["hostile"]["promises"].values()) else 1)
    assert "--- hostile" in capsys.readouterr().out


def test_seeds_that_are_no_range_are_bad_usage(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--seeds", "5:5"])
    assert ended.value.code == 2
    assert "5:5" in capsys.readouterr().err


def test_hostile_parts_refuse_a_cell_of_several_arms(capsys):
    assert main(["--only", "hostile", "--cells", "pa10_two", "--seeds", "0:1"]) == 2
    assert "hostile parts lead one arm; the part 'arms' leads two" in capsys.readouterr().err
