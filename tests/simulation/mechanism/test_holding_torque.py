"""Spare joints take load off the drives, by the torques that the drives measure."""

import numpy as np
import pytest
from telerobot.config.load import altered

ASIDE = (0.1, -0.1, 0.5, 2.1, 0.0, -0.4, -0.6)
"""The elbow aside [rad]."""
HUNG, COM = 6.0, (0.05, 0.0, 0.1)
"""True load on the sensor beside the hand [kg], [m]."""
HAND, HAND_COM = 0.98, 0.051
WHOLE = HUNG + HAND
WHOLE_COM = (HUNG * COM[0] / WHOLE, 0.0, (HUNG * COM[2] + HAND * HAND_COM) / WHOLE)


@pytest.fixture
def laden(pa10):
    """A PA-10 with 6 kg beside the hand's axis, its elbow aside, its null space idle."""
    return altered(
        pa10,
        {
            "rig.wall": None,
            "rig.boxes": (),
            "rig.payload_mass": HUNG,
            "rig.payload_com": COM,
            "mechanism.postures.start": ASIDE,
            "mechanism.force_torque.payload.mass": WHOLE,
            "mechanism.force_torque.payload.com": WHOLE_COM,
            "redundancy.mid_range": 0.0,
        },
    )


def test_an_arm_holds_what_it_carries_with_less_of_its_ratings_and_the_tool_stands(laden, play):
    relieve = {"objective": "holding_torque", "gain": 2.0}
    run = play({"at_s": 0.5, "operator/redundancy": relieve}, cell=laden, seconds=9.0)
    assert run.summary["refused"] == []
    assert run.summary["failure"] is None
    assert run.summary["limit_violations"] == 0
    rated = np.array([drive.rated_torque for drive in laden.config.mechanism.drives])

    def load(from_s, to_s):
        """Return the mean sum of squared measured torques over the ratings."""
        start = run.simulation.player.start_s
        taus = [s.tau for s in run.states if from_s <= s.time_s - start <= to_s]
        return float(((np.array(taus) / rated) ** 2).sum(axis=1).mean())

    before, after = load(0.2, 0.5), load(8.5, 9.0)
    assert before > 1.8
    assert after < 0.8 * before
    start = run.simulation.player.start_s
    tools = np.array([t.pose_mrf[:3] for t in run.truths if t.time_s >= start + 0.4])
    assert np.linalg.norm(tools - tools[0], axis=1).max() < 1e-3
    gain, size = run.at(3.0).objectives["holding_torque"]
    assert gain == pytest.approx(2.0)
    assert size > 0.01
