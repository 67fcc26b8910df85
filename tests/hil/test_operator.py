"""`telerobot.Operator` against a real daemon: what a user's script sees."""

import pytest
from telerobot import Operator, OperatorError
from telerobot.protocols import topics as t

pytestmark = pytest.mark.hil

STICK = [0.0, 0.0, 0.03, 0.0, 0.0, 0.0]


def test_an_operator_moves_the_arm_and_leaves_it_holding(plant):
    with Operator(plant.cell, name="ann") as ann:
        ann.acquire()
        ann.enable()
        plant.turn()
        before = plant.truth.pose_mrf[2]
        ann.joystick(STICK, seconds=1.0, expressed_in="base")
        assert ann.round_trip.seconds is not None
    watcher = plant.operator("watcher")
    plant.until(lambda: watcher.state.mode == "hold", 3.0)
    assert plant.truth.pose_mrf[2] - before == pytest.approx(0.03, abs=0.01)
    assert watcher.state.lease_holder is None


def test_enabled_at_once_after_it_was_disabled_every_drive_is_on(plant):
    ann = plant.enabled_operator("ann")
    for _ in range(4):
        ann.disable()
        ann.wait_mode("ready")
        plant.newer_truth(ann)  # the one that is there by now may be older than the telemetry
        assert set(plant.truth.drives) <= {"switch_on_disabled", "ready_to_switch_on"}
        ann.enable()
        plant.newer_truth(ann)
        assert set(plant.truth.drives) == {"operation_enabled"}
    ann.joystick(STICK, seconds=0.5, expressed_in="base")
    assert ann.state.mode == "enabled"


def test_a_goal_is_waited_for_from_when_it_was_heard(plant):
    ann = plant.enabled_operator("ann")
    ann.posture("ready")
    plant.reach(ann, 20.0)
    ann.move_to([0.0, 0.05, 0.0], [0.0, 0.0, 0.0], relative_to="mrf")
    assert not ann.wait_goal(0.02), "at_goal is still that of the posture before"
    plant.reach(ann, 20.0)
    assert ann.state.target_mrf is not None
    assert ann.state.pose_mrf[:3] == pytest.approx(ann.state.target_mrf[:3], abs=2e-3)


def test_a_script_that_hangs_loses_the_lease_and_is_told(plant):
    ann = plant.enabled_operator("ann")
    ann.joystick(STICK)
    plant.operators.remove(ann)  # nobody calls spin any more
    watcher = plant.operator("watcher")
    plant.until(lambda: watcher.state.lease_holder is None, 5.0, "the lease does not end")
    plant.until(lambda: watcher.state.mode == "hold", 3.0, "the arm does not hold")
    watcher.acquire()
    ann.spin(0.2)
    assert not ann.holds_lease
    with pytest.raises(OperatorError) as caught:
        ann.joystick(STICK)
    assert caught.value.reason == "no_lease"
    ann.close()


def test_a_refusal_carries_its_reason(plant):
    ann, bob = plant.operator("ann"), plant.operator("bob")
    ann.acquire()
    with pytest.raises(OperatorError) as caught:
        bob.acquire()
    assert caught.value.reason == "lease_taken"
    assert "ann" in caught.value.detail
    with pytest.raises(OperatorError) as caught:
        bob.enable()
    assert caught.value.reason == "no_lease"
    with pytest.raises(OperatorError) as caught:
        ann.request(t.MODE, action="resume")
    assert caught.value.reason == "not_now"


def test_anyone_may_stop_the_arm(plant):
    ann, bob = plant.enabled_operator("ann"), plant.operator("bob")
    bob.protective_stop()
    plant.until(lambda: ann.state.mode == "hold", 3.0)
    with pytest.raises(OperatorError) as caught:
        ann.enable()
    assert caught.value.reason == "protective_stop"
    bob.clear_protective_stop()
    ann.enable()


def test_where_no_daemon_listens_is_said():
    with pytest.raises(OperatorError) as caught:
        Operator("pa10", endpoint="tcp/127.0.0.1:1")
    assert str(caught.value) == "no_daemon: nobody answers at tcp/127.0.0.1:1"
