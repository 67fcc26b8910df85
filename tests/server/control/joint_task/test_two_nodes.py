"""Two arms put a beam's pegs into two nodes, which neither could alone (Williams 1997, section 4).

Nodes are not where the drawing has them, nor as far apart. By stick, and by the physics' truth.
"""

import numpy as np
import pytest

from .carrying import Carrying, T, pair

LEFT = "misplaced = { xyz = [0.002, 0.00115, 0.0] }"
RIGHT = "misplaced = { xyz = [0.002, 0.00085, -0.002] }"
AHEAD = [0.004, 0.0, 0.0, 0.0, 0.0, 0.0]

AS_BUILT = ()
"""2 mm up, 1 mm across, one 2 mm farther, 0.3 mm too far apart."""
TILTED = (
    (LEFT, "misplaced = { xyz = [0.002, 0.00015, 0.0] }"),
    (RIGHT, "misplaced = { xyz = [-0.002, -0.00015, -0.002] }"),
)

BOTH = (
    (LEFT, "misplaced = { xyz = [0.004, 0.00115, 0.0] }"),
    (RIGHT, "misplaced = { xyz = [0.0, 0.00085, -0.002] }"),
)
"""As built, and tilted by 2 mm at either end."""


def inserted(run, seconds=12.0, deep=20e-3, ahead=AHEAD):
    """Push ahead until both pegs are so deep; return their depths [m] and the greatest push [N]."""
    push = 0.0
    for _ in range(round(seconds / T)):
        run.tick(ahead)
        push = max(push, float(np.linalg.norm(run.world.contacts.force(2))))
        if min(run.world.beam.peg_depths()) >= deep:
            break
    return run.world.beam.peg_depths(), push


@pytest.mark.parametrize("changes", [AS_BUILT, TILTED, BOTH], ids=["as built", "tilted", "both"])
def test_both_pegs_go_in_gently_while_force_control_melts_what_does_not_fit(tmp_path, changes):
    run = Carrying(pair(tmp_path, *changes, nodes=True))
    depths, push = inserted(run)
    assert min(depths) >= 20e-3
    assert 5.0 < push <= 25.0, "the pegs touched nothing, or were forced in"
    assert max(force for force, _, _ in run.truth) <= 10.0


@pytest.mark.parametrize("mass", [3.5, 9.0])
def test_both_pegs_of_a_beam_that_is_told_5_kg_go_in(tmp_path, mass):
    run = Carrying(pair(tmp_path, ("mass = 5.0\ngrasp", f"mass = {mass}\ngrasp"), nodes=True))
    run.run(0.5)
    depths, push = inserted(run)
    assert min(depths) >= 20e-3
    assert push <= 27.0  # 25 with a mass that is told
    assert max(force for force, _, _ in run.truth) <= 10.0


def test_both_pegs_go_in_by_a_desired_wrench_alone(tmp_path):
    run = Carrying(pair(tmp_path, nodes=True))
    run.wrench_desired = np.array([22.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    depths, push = inserted(run, ahead=None)
    assert min(depths) >= 20e-3
    assert 5.0 < push <= 22.0
    assert max(force for force, _, _ in run.truth) <= 10.0


def test_without_force_control_the_beam_is_forced_and_stays_outside(tmp_path):
    run = Carrying(pair(tmp_path, *TILTED, nodes=True))
    run.force_gain(0.0, 0.0)
    depths, push = inserted(run, seconds=5.5)
    assert max(depths) < 10e-3
    assert push > 100.0
