"""After a touch the arm lets go: judged by the physics' contact force."""

import numpy as np
import pytest
from laboratory.campaign.contact import doubted, letting_go
from telerobot.config.load import altered

STIFF = {
    "forearm csp": (0, 2e5, "csp", True),
    "forearm csp, no sensor": (0, 2e5, "csp", False),
    "elbow csv, no sensor": (1, 2e5, "csv", False),
    "elbow cst": (2, 2e5, "cst", True),
}
"""Of the campaign's table, see `letting_go.TABLE`."""

MOVING = {"twist": [0.0, 0.05, 0.02, 0.0, 0.0, 0.1], "expressed_in": "base"}


@pytest.mark.parametrize("row", STIFF.values(), ids=STIFF.keys())
def test_an_arm_that_ran_into_something_lets_go_and_can_be_moved_away(row):
    run = letting_go.play(letting_go.listed(letting_go.TABLE.index(row)), held_s=3.0)
    assert run.reasons == []
    assert run.peak_n > letting_go.GENTLE_N


def test_it_lets_go_of_a_soft_wall_in_a_drawn_posture():
    run = letting_go.play(letting_go.drawn(8), held_s=2.0)
    assert run.reasons == []


def test_a_wrist_that_a_wrong_payload_presses_on_a_table_lets_go():
    run = letting_go.play(letting_go.laden(letting_go.LADEN.index((2e5, "csp"))))
    assert run.reasons == []
    assert run.peak_n > 4 * letting_go.GENTLE_N


@pytest.mark.parametrize(
    "row",
    [
        ("pa10", "csp", 2e5, 5.0, ("stick", 0.1)),
        ("pa10_hand_torque", "cst", 2e5, 5.0, ("stick", 0.1)),
    ],
    ids=["csp", "cst, without [touch]"],
)
def test_a_tool_whose_load_nobody_acknowledged_lets_go_of_a_table(row):
    run = letting_go.play(doubted.doubted(doubted.TABLE.index(row)), held_s=1.5)
    assert run.reasons == []
    assert run.peak_n > 3 * letting_go.GENTLE_N


@pytest.mark.parametrize("cell", ["pa10", "pa10_hand_torque"], ids=["touch", "no touch"])
def test_a_tool_that_a_stiff_wall_throws_off_is_not_led_back_into_it(cell):
    """At a rate that went by the push it came back with 224 N, over a second after the stop."""
    row = (cell, "csp", 2e5, -5.0, ("stick", 0.02))
    run = letting_go.play(doubted.doubted(doubted.TABLE.index(row)), held_s=1.5)
    assert run.reasons == []
    assert run.pressed_n == 0.0


@pytest.mark.parametrize(
    "row",
    [
        ("pa10", "csv", 2e3, 5.0, ("stick", 0.1)),
        ("pa10", "cst", 2e3, 5.0, ("stick", 0.02)),
        ("pa10_hand_torque", "csp", 2e3, 5.0, ("stick", 0.1)),
    ],
    ids=["csv", "cst, slowly", "csp, without [touch]"],
)
def test_contact_that_takes_off_a_weight_and_adds_as_much_of_its_own_is_felt_early(row):
    """Pushed up by a soft table, the force swings from 49 N down over 40 N aside to 60 N up."""
    run = letting_go.play(doubted.doubted(doubted.TABLE.index(row)), held_s=1.0)
    assert run.reasons == []
    assert run.peak_n < 80.0
    assert run.pressed_n < 10.0


@pytest.mark.parametrize(
    "row",
    [
        ("pa10", "csp", 2e3, -5.0, ("stick", 0.02)),
        ("pa10_hand_torque", "cst", 2e5, -5.0, ("stick", 0.1)),
    ],
    ids=["csp", "cst, without [touch]"],
)
def test_an_arm_that_lets_go_comes_to_rest_and_says_so_with_a_load_that_is_not_there(row):
    """Its inertia, which is taken off the reading, is no push that lasts."""
    run = letting_go.play(doubted.doubted(doubted.TABLE.index(row)), held_s=1.5)
    assert run.reasons == []
    assert run.gave_way_rad < 0.05


@pytest.mark.parametrize(
    "row",
    [("pa10", "csv", 2e3, 5.0, ("jog", 0.1)), ("pa10", "cst", 2e5, 5.0, ("jog", 0.1))],
    ids=["csv", "cst"],
)
def test_force_control_that_waits_relieves_nothing_so_the_way_of_a_jog_is_kept(row):
    """A load that is not explained reads like contact from the first moment of the jog on."""
    run = letting_go.play(doubted.doubted(doubted.TABLE.index(row)), held_s=1.5)
    assert run.reasons == []
    assert run.pressed_n == 0.0


def test_a_push_that_lasts_is_given_way_to_inside_the_leash_and_told(play, pa10):
    run = play(
        {"at_s": 0.3, "cmd/joystick": MOVING},
        {"at_s": 2.0, "rig/fault": {"kind": "push", "target": "e1", "vector": [-30.0, 0.0, 0.0]}},
        {"at_s": 7.0, "rig/fault": {"kind": "push", "target": "e1", "on": False}},
        {"at_s": 7.5, "operator/mode": {"action": "resume"}},
        seconds=7.7,
    )
    (giving, *_), (stuck,) = run.events("giving_way"), run.events("still_pushed")
    assert giving.values["joint"] == "s2"
    assert stuck.severity == "warning"
    held = np.array([s.q_command for s in run.states if s.mode == "hold"])
    travel = np.abs(held - held[0]).max()
    assert 0.5 * pa10.config.touch.leash < travel <= pa10.config.touch.leash
    assert travel <= stuck.values["travelled_rad"] <= pa10.config.touch.leash
    assert run.states[-1].mode == "enabled"
    assert run.summary["limit_violations"] == 0


def test_a_load_that_nobody_told_of_moves_nothing_in_hold(play, pa10):
    """Without a sensor its weight looks like a push: the arm stops, and does not sink."""
    cell = altered(
        pa10,
        {
            "mechanism.force_torque": None,
            "rig.payload_mass": 5.0,
            "rig.payload_com": (0.0, 0.0, 0.1),
            "rig.wall": None,
            "rig.boxes": (),
        },
    )
    run = play({"at_s": 0.3, "cmd/joystick": MOVING}, seconds=3.0, cell=cell)
    assert run.events("touched")
    assert run.events("still_pushed")
    held = np.array([s.q_command for s in run.states if s.mode == "hold"])
    assert np.abs(held - held[0]).max() < 1e-3


def test_without_a_sensor_the_tool_is_that_of_the_urdf_and_no_push(play, pa10):
    cell = altered(pa10, {"mechanism.force_torque": None})
    run = play({"at_s": 0.3, "cmd/joystick": MOVING}, seconds=3.0, cell=cell)
    assert run.events("touched") == []
    assert run.states[-1].mode == "enabled"


def test_contact_that_a_stop_runs_into_is_let_go_of_as_well():
    """The operator's own HOLD comes as the forearm meets the post, before that was felt."""
    plan = letting_go.listed(letting_go.TABLE.index(STIFF["forearm csp"]))
    felt_s = letting_go.play(plan, held_s=0.1).touched_s
    run = letting_go.play(plan, held_s=2.0, hold_s=felt_s - 0.01)
    assert run.reasons == []


@pytest.mark.parametrize("speed", [0.2, 0.3])
def test_a_link_that_a_stick_pressed_on_a_table_lets_go_though_a_joint_is_held_up(play, speed):
    over = {"at_s": 0.2, "cmd/posture": {"q": [0.0, 0.46, 0.0, 2.1, 0.0, -0.7792, 0.0]}}
    down = {"twist": [0.0, 0.0, -speed, 0.0, 0.0, 0.0], "expressed_in": "base"}
    run = play(over, {"at_s": 1.5, "cmd/joystick": down}, seconds=4.0)
    assert run.states[-1].mode == "hold"
    pressed = [arm.contact_sum for truth in run.truths for arm in truth.arms.values()]
    assert max(pressed) > 400.0
    assert max(pressed[-100:]) < 5.0
