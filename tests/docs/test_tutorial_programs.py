"""Programs that tutorials begin from, in virtual time: a policy, a demonstration played again."""

import sys

import numpy as np
import pytest
from laboratory.tutorials import demonstration, policy
from telerobot import OperatorError, SimulatedOperator, load_cell
from telerobot.tools.cli import main
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

WAY = np.array([0.0, 0.04, 0.06])
"""From the tool to the place that the policy leads it to, in World [m]."""
STEPS = [
    {"at_s": 0.1, "cmd/joystick": {"twist": [0, 0.1, 0.05, 0, 0, 0.2]}, "for_s": 0.8},
    {"at_s": 0.9, "cmd/joystick": {"twist": [0, 0, 0.1, 0, 0, 0]}, "for_s": 0.5},
]


@pytest.fixture(scope="module")
def pa10():
    return load_cell("pa10")


@pytest.fixture
def operator(pa10):
    """An operator who has the arm enabled."""
    with SimulatedOperator(pa10) as operator:
        operator.acquire()
        operator.enable()
        yield operator


@pytest.fixture(scope="module")
def recorded(pa10, tmp_path_factory):
    """A run with a motion in it, as `telerobot export` writes it."""
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    Simulation(pa10, Script.model_validate({"duration_s": 2.0, "step": STEPS}), file).run()
    assert main(["export", str(file), "--to", "numpy"]) == 0
    return file.with_suffix(".numpy") / "run.npz"


def truth(operator):
    return operator.simulation.truths[-1]


def test_a_policy_leads_the_tool_to_its_place_and_the_arm_then_stands(operator):
    start, seen = np.array(truth(operator).pose_mrf[:3]), []
    reach = policy.ReachPolicy(policy.observation(operator.wait_state())[:3] + WAY)
    policy.run(operator, lambda x: seen.append(x) or reach(x), seconds=4.0)
    assert np.abs(np.array(truth(operator).pose_mrf[:3]) - start - WAY).max() < 2e-3
    assert max(map(abs, truth(operator).dq)) < 0.005
    assert len(seen) == 4.0 * policy.RATE
    assert operator.state.mode == "enabled"


def test_a_policy_that_gives_no_twist_ends_the_motion_with_its_operator(pa10):
    twists = iter([[0.0, 0.0, 0.05, 0.0, 0.0, 0.0]] * 10)
    with SimulatedOperator(pa10, name="watcher") as watcher:
        with SimulatedOperator(watcher.simulation, name="ann") as ann:
            ann.acquire()
            ann.enable()
            with pytest.raises(ValueError, match="twist"):
                policy.run(ann, lambda _x: np.array(next(twists, [np.nan] * 6)), seconds=5.0)
            assert max(map(abs, truth(ann).dq)) > 0.01
        watcher.wait_mode("hold", 2.0)
        watcher.spin(0.3)
        assert max(map(abs, truth(watcher).dq)) < 0.002
        assert watcher.state.lease_holder is None


def test_a_demonstration_is_played_where_and_as_it_was_shown(operator, recorded):
    run, told = np.load(recorded), []
    operator.on_state = lambda state: told.append(state.q)
    demonstration.run(operator, demonstration.postures(recorded))
    shown, played = run["action.q"], np.array(told)
    assert np.ptp(shown, axis=0).max() > 0.1
    off = [np.abs(played - q).max(axis=1).min() for q in shown]
    assert max(off) < 5e-3
    assert np.abs(played[-1] - shown[-1]).max() < 2e-3
    assert operator.simulation.observer.violations == []


def test_a_demonstration_beyond_a_limit_is_refused(operator, recorded):
    shown = demonstration.postures(recorded)[:8]
    beyond = shown + np.linspace(0.0, 8.0, 8)[:, None] * np.eye(7)[0]
    with pytest.raises(OperatorError) as caught:
        demonstration.run(operator, beyond)
    assert caught.value.reason == "out_of_range"
    operator.spin(0.5)
    assert operator.simulation.observer.violations == []


def test_a_protective_stop_ends_a_demonstration(operator, recorded):
    bob = SimulatedOperator(operator.simulation, name="bob")
    shown = np.repeat(demonstration.postures(recorded), 2, axis=0)

    def watch(state):
        if abs(state.q[0] - shown[0][0]) + abs(state.dq_command[0]) > 0.02:
            operator.on_state = lambda _state: None
            bob.client.protective_stop(lambda _reply: None)

    operator.on_state = watch
    with pytest.raises(OperatorError) as caught:
        demonstration.run(operator, shown)
    assert caught.value.reason == "not_now"
    operator.wait_mode("hold", 2.0)
    operator.spin(0.3)
    assert max(map(abs, truth(operator).dq)) < 0.002


def test_a_run_in_which_nothing_moves_is_no_demonstration(tmp_path):
    still = {"time_s": np.arange(3.0), "action.q": np.zeros((3, 7)), "action.dq": np.zeros((3, 7))}
    np.savez(tmp_path / "run.npz", **still)
    with pytest.raises(ValueError, match="nothing moves"):
        demonstration.postures(tmp_path / "run.npz")


def test_the_programs_run_as_they_are(recorded, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["policy", "pa10", "--simulate"])
    policy.main()
    assert float(capsys.readouterr().out.split()[0]) < 3.0
    monkeypatch.setattr(sys, "argv", ["demonstration", "pa10", str(recorded), "--simulate"])
    demonstration.main()
    assert "postures played" in capsys.readouterr().out
