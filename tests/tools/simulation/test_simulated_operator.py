"""`SimulatedOperator`: a user's script on a whole cell in its own process, in virtual time."""

import pytest
from telerobot import OperatorError, SimulatedOperator, load_cell
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.recording.replay import Replay
from telerobot.tools.recording.run_file import read_cell

STICK = [0.0, 0.0, 0.05, 0.0, 0.0, 0.0]


@pytest.fixture(scope="module")
def pa10():
    return load_cell("pa10")


def driven(cell, record=None):
    """Return where the joints ended, to the last bit."""
    with SimulatedOperator(cell, record=record) as operator:
        operator.acquire()
        operator.enable()
        operator.joystick(STICK, seconds=0.3, expressed_in="base")
        operator.spin(0.2)
        return operator.simulation.truths[-1].q


def test_equal_programs_give_equal_runs_and_their_recording_replays(pa10, tmp_path):
    file = tmp_path / "run.mcap"
    assert driven(pa10) == driven(pa10, file)
    replay = Replay(file, read_cell(file))
    assert any(tick.inputs[0].stick is not None for tick in replay.run())
    assert replay.judgement.difference is None


def test_time_stands_between_calls_and_a_fault_is_felt(pa10):
    with SimulatedOperator(pa10) as operator:
        operator.acquire()
        operator.enable()
        before_s = operator.clock.now()
        assert operator.wait_state().mode == "enabled"
        assert operator.clock.now() == before_s
        operator.spin(0.1)
        assert operator.clock.now() == pytest.approx(before_s + 0.1, abs=0.0101)
        operator.inject(RigFault(kind="fault", target="s1"))
        operator.wait_mode("fault", 0.5)


def test_a_paced_loop_skips_what_it_is_too_late_for(pa10):
    with SimulatedOperator(pa10) as operator:
        start_s, at = operator.clock.now(), []
        for i in operator.paced(20.0, 1.0):
            at.append((i, operator.clock.now() - start_s))
            if i == 4:
                operator.spin(0.13)  # a body that takes long
        assert [i for i, _ in at] == [*range(5), *range(6, 20)]
        late = [s - i / 20.0 for i, s in at if i != 6]
        assert max(late) < 0.011
        assert min(late) > -1e-6


def test_a_lease_that_nobody_renews_runs_out(pa10):
    with SimulatedOperator(pa10) as operator:
        operator.acquire()
        operator.enable()
        for _ in range(100):
            operator.simulation.step()  # time passes outside of the session
        operator.spin(0.05)
        assert not operator.holds_lease
        with pytest.raises(OperatorError, match="no_lease"):
            operator.joystick(STICK)
