"""Steps that wait: by position, then by vision, then until a sufficient force is sensed.

On exact sights in place of pictures; judged by the physics.
"""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak import cli as sights


@pytest.fixture
def play(monkeypatch):
    for wrong, much in (("NOISE", (0.0, 0.0)), ("LATE", 0.0), ("LEAPING", 0.0)):
        monkeypatch.setattr(sights, wrong, much)

    def run(cell, on_tick=None):
        script = load_script("see_and_press")
        made = Simulation(cell, script, cameras=lambda s: sights.ComputedSights(s, seed=0))
        made.on_tick = on_tick
        return made, made.run()

    return run


def test_each_step_goes_on_when_what_it_waits_for_is_really_so(play):
    told, true = [], []

    def look(run):
        said, really = run.states[-1].view_error, run.view.error(run.truths[-1])
        if said is not None and really is not None:
            told.append((run.clock.time_s, *said))
            true.append(really)

    run, result = play(load_cell("pa10_all"), look)
    assert result.ok, [str(row) for row in result.expected if not row.met]
    assert result.summary["refused"] == []
    told, true = np.array(told), np.array(true)
    assert true[:, 0].max() > 0.1
    # The newest sight is some periods old, while the tool goes at up to 0.1 m/s.
    np.testing.assert_allclose(told[:, 1:], true, atol=0.02)
    on, off = (e.time_s for e in run.events if e.name == "source_switched")
    switched = np.searchsorted(told[:, 0], (on, off))
    assert true[switched[0], 0] > 0.1
    assert true[switched[1], 0] < 0.004
    assert true[switched[1], 1] < 0.006
    # Back it goes once 5 N are felt, and not before.
    forces = np.array([np.linalg.norm(truth.contact_force) for truth in result.truths])
    sticks = np.array([state.sources["joystick"][0] for state in result.states])
    back = int(np.argmax(sticks[-len(forces) :] < 0.0))
    assert 4.0 < forces[back - 55 : back].max() < 20.0


def test_a_force_that_is_waited_for_in_vain_leaves_the_arm_in_hold(play):
    run, result = play(altered(load_cell("pa10_all"), {"wall": None}, "rig"))
    assert result.summary["mode"] == "hold"
    assert result.summary["failure"] is None
    assert result.summary["contact_peak_n"] == 0.0
    # 0.02 m/s for the eight seconds of the wait, and the steps that back off are left out.
    begun = next(s for s in run.states if s.sources["joystick"][0] > 0.0)
    assert run.states[-1].pose_mrf[0] - begun.pose_mrf[0] == pytest.approx(0.16, abs=0.02)
