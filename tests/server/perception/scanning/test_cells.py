"""Cells that one scanner, with its noise, makes of a bridge: those of the true shape.

The true cells come from a grid ten times as fine; a cell is to be found where the bridge fills it
as seen from ahead, and false where the bridge does not reach into it.
"""

import numpy as np
import pytest
from laboratory.papers.rover import FOOT, Rover, found_and_false
from telerobot.config.schema.rig import RigBridgeSection


@pytest.mark.parametrize(("height", "width"), [(0.95, 1.4), (1.0, 1.25)])
def test_after_two_sweeps_nearly_every_cell_of_a_bridge_at_two_metres_is_found(
    height: float, width: float
) -> None:
    bridge = RigBridgeSection(height=height, width=width, distance=2.0 + FOOT[0])
    rover = Rover(bridge).run(4.1)
    found, false = found_and_false(rover, bridge)
    assert found >= 0.98
    assert false <= 1
    if width > 1.3:  # tails of noise add up
        assert found_and_false(rover.run(5.9), bridge)[1] <= 1


def test_an_arm_in_view_hides_little_and_is_no_obstacle() -> None:
    bridge = RigBridgeSection(height=0.95, width=1.4, distance=1.0 + FOOT[0])
    rover = Rover(bridge, start=(0.0, 0.9, 0.0, 1.2, 0.0, 0.0, 0.0), sweep=(-1.3, 0.5))
    q = rover.q.copy()
    own = 0
    for _ in range(410):
        rover.step()
        rover.q[2:-1] = q[2:-1]  # it stays where it is, whatever would fit
        own += 0 if rover.newest is None else np.count_nonzero(rover.newest.own)
    assert own > 1000
    found, false = found_and_false(rover, bridge)
    assert false == 0
    assert found >= 0.95
