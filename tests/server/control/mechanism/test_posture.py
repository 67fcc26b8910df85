import numpy as np
from telerobot.server.control.mechanism.objectives import Posture

from .shown import built, joints, shown


def test_a_posture_pulls_in_proportion(pa10):
    q, to = np.array([0.1, -0.2]), np.array([0.4, 0.3])
    objective = built(Posture, joints(-np.ones(2), np.ones(2)), pa10.mechanism)
    np.testing.assert_allclose(objective.rate(shown(q, posture=to)), [0.3, 0.5])
