"""One arm of two that hold a beam loses its power on the move: its brakes fall in, the other stops.

By physics truth. All directions stand in `server/control/joint_task/README.md`: backwards with the
right arm's brakes, and along the beam, it is more than the 30 N that are wanted.
"""

import numpy as np
import pytest
from telerobot.config.load import load_cell

SPEED = 0.25

CASES = {
    "backwards, right": ([-1.0, 0.0, 0.0], "right", 45.0),
    "along the beam, left": ([0.0, -1.0, 0.0], "left", 45.0),
    "down, left": ([0.0, 0.0, -1.0], "left", 30.0),
}
"""Way of the beam, arm that loses its power, bound of internal force [N]."""


@pytest.fixture(scope="module")
def pair():
    return load_cell("pa10_pair")


@pytest.mark.parametrize(("way", "arm", "bound"), CASES.values(), ids=list(CASES))
def test_brakes_of_one_arm_pull_at_the_payload_no_harder_than_is_told(play, pair, way, arm, bound):
    twist = [SPEED * part for part in way] + [0.0] * 3
    joints = [joint.name for joint in pair.parts[0].robot.joints]
    run = play(
        {"at_s": 0.05, "for_s": 2.0, "cmd/joystick": {"twist": twist, "expressed_in": "world"}},
        *({"at_s": 0.5, "rig/fault": {"kind": "fault", "target": f"{arm}.{j}"}} for j in joints),
        seconds=0.65,
        cell=pair,
    )
    assert gone(run, 0.4, 0.485) @ way > 0.07 * 0.95 * SPEED
    assert run.summary["mode"] == "fault"
    assert "operation_enabled" not in run.truths[-1].drives
    assert run.summary["internal_force_n"]["max"] < bound


def gone(run, from_s, to_s):
    """Return the way of the beam between two times of the script (3,) [m]."""
    start = run.simulation.player.start_s
    way = [t.beam.pose[:3] for t in run.truths if from_s <= t.time_s - start - 1e-9 <= to_s]
    return np.subtract(way[-1], way[0])
