"""Force control on something stiffer than the cell declares rings once, is slowed down, and said.

Judged by the physics: 20 kN/m is declared, and the stick presses with K_HC u / K_F = 40 N.
"""

import numpy as np
import pytest
from laboratory.campaign.contact.sliding import Slide, sliding
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

READY = {"at_s": 0.0, "cmd/posture": {"posture": "ready"}}
STICK = {"twist": [0.03, 0, 0, 0, 0, 0], "expressed_in": "base"}
PRESSED_N = 0.03 / 7.5e-4


def before(stiffness):
    """Return the PA-10 before a wall [N/m], or before a rigid block."""
    cell = load_cell("pa10")
    rig = cell.config.rig
    if stiffness is None:
        block = {"name": "block", "xyz": (0.9, 0.0, 0.5), "half_size": (0.1, 0.25, 0.25)}
        boxes = (*rig.boxes, type(rig.boxes[0]).model_validate(block))
        changed = rig.model_copy(update={"wall": None, "boxes": boxes})
    else:
        wall = type(rig.wall).model_validate({**rig.wall.model_dump(), "stiffness": stiffness})
        changed = rig.model_copy(update={"wall": wall})
    return altered(cell, {"rig": changed})


def play(cell, *steps, seconds):
    script = Script.model_validate({"duration_s": seconds, "step": [READY, *steps]})
    simulation = Simulation(cell, script)
    return Run(simulation, simulation.run())


def forces(run):
    """Return times and true contact forces (k, 2) [s, N]."""
    return np.array([(t.time_s, np.linalg.norm(t.contact_force)) for t in run.truths])


@pytest.mark.parametrize("stiffness", [1e5, 4e5, None], ids=["100 kN/m", "400 kN/m", "rigid"])
def test_a_wall_stiffer_than_declared_is_named_at_once_and_rings_no_more(stiffness):
    run = play(before(stiffness), {"at_s": 2.6, "cmd/joystick": STICK}, seconds=7.6)
    (said,) = run.events("contact_unstable")
    found = forces(run)
    touched_s = found[np.argmax(found[:, 1] > 0.0), 0]
    assert said.time_s - touched_s < 0.15
    assert said.values["stiffness"] > 0.4 * (stiffness or 4e5)
    if stiffness == 1e5:
        assert said.values["stiffness"] == pytest.approx(1e5, rel=0.15)
    after = found[found[:, 0] > said.time_s + 0.1, 1]
    assert after.max() < 1.4 * PRESSED_N
    settled = found[found[:, 0] > found[-1, 0] - 0.5, 1]
    assert np.ptp(settled) < 0.25 * PRESSED_N
    assert run.summary["mode"] == "enabled"


def test_a_target_inside_a_rigid_block_ends_in_no_fault_and_leaves_no_force():
    target = {"xyz": [0.2, 0, 0], "rpy": [0, 0, 0], "relative_to": "mrf",
              "expressed_in": "base", "speed": 0.1}  # fmt: skip
    run = play(before(None), {"at_s": 2.6, "cmd/position": target}, seconds=6.0)
    assert len(run.events("contact_unstable")) == 1
    assert [e.values["by"] for e in run.events("goal_dropped")] == ["contact_unstable"]
    assert run.summary["mode"] == "enabled"
    found = forces(run)
    touched_s = found[np.argmax(found[:, 1] > 0.0), 0]
    # One impact, of the way and the time that are gone before anything can be felt.
    assert found[found[:, 0] > touched_s + 0.1, 1].max() < 2.0


def test_the_wall_that_is_declared_does_not_ring_and_nothing_is_slowed_down(pa10):
    run = play(pa10, {"at_s": 2.6, "cmd/joystick": STICK}, seconds=7.0)
    assert run.events("contact_unstable") == []
    assert not any("contact" in s.limits for s in run.states)
    assert forces(run)[-1, 1] == pytest.approx(PRESSED_N, rel=0.05)


def test_it_stays_gentle_towards_the_wall_alone_until_the_gains_are_told_anew():
    back = {"twist": [-0.05, 0, 0, 0, 0, 0], "expressed_in": "base"}
    gain = [1e-4, 1e-4, 1e-4, 0.03, 0.03, 0.03]
    run = play(
        before(1e5),
        {"at_s": 2.6, "cmd/joystick": STICK},
        {"at_s": 6.5, "cmd/joystick": back},
        {"at_s": 8.0, "cmd/joystick": STICK},
        {"at_s": 8.5, "operator/gain": {"source": "force", "gain": gain}},
        seconds=9.2,
    )
    assert len(run.events("contact_unstable")) == 1
    speed = lambda at: (run.at(at + 0.1).pose_mrf[0] - run.at(at).pose_mrf[0]) / 0.1  # noqa: E731
    assert speed(7.6) == pytest.approx(-0.05, rel=0.05)
    assert 0.0 < speed(8.3) < 0.01
    assert speed(9.0) == pytest.approx(0.03, rel=0.05)


def test_back_along_a_rigid_table_does_not_lead_away_from_it(pa10):
    """The touch leans a little: taken for the way off, back along it pressed with 208 N."""
    simulation = Simulation(pa10, sliding(pa10, Slide("table", 10.0, 0.1, 0)))
    run = Run(simulation, simulation.run())
    (said,) = run.events("contact_unstable")
    assert (
        max(t.arms["arm"].contact_peak for t in run.truths if t.time_s > said.time_s + 0.1) < 60.0
    )
    assert run.summary["mode"] == "enabled"
