import numpy as np
import pytest
from telerobot.server.control.mechanism.objectives import MidRange

from .shown import built, joints, shown

LOWER, UPPER = np.array([-1.0, -2.0, 0.0, -20.0]), np.array([1.0, 2.0, 4.0, 20.0])
MIDDLE = np.array([0.0, 0.0, 2.0, 0.0])


@pytest.fixture
def objective(pa10):
    return built(MidRange, joints(LOWER, UPPER), pa10.mechanism)


def test_every_joint_is_drawn_to_the_middle_of_its_range(objective, rng):
    assert not objective.rate(shown(MIDDLE)).any()
    for q in rng.uniform(LOWER, UPPER, (20, 4)):
        rate = objective.rate(shown(q))
        assert (rate * (MIDDLE - q) > 0).all()


def test_a_joint_with_more_room_is_drawn_less(objective):
    rates = objective.rate(shown(MIDDLE - 0.5))
    np.testing.assert_allclose(rates, [0.5, 0.25, 0.25, 0.5 / np.pi])


def test_self_motion_goes_to_mid_range_and_leaves_the_tool_where_it_is(pa10, start, rng):
    """The elbow swings down from the side; the tool does not notice."""
    swung = pa10.posture("ready") + np.array([0.3, 0.0, -0.4, 0.0, 0.3, 0.1, 0.0])
    run = start(pa10, swung)
    middle = 0.5 * (pa10.p.joints.lower + pa10.p.joints.upper)
    pull = built(MidRange, pa10.p.joints, pa10.mechanism)

    def strain():
        """What the pull is the downward slope of."""
        away = middle - run.sent[-1]
        return float(pull.rate(shown(run.sent[-1])) @ away)

    before, at = strain(), run.pose
    strains = [before]
    for _ in range(8):
        run.go(1.0)
        strains.append(strain())
    assert (np.diff(strains) < 0).all()
    assert strains[-1] < 0.98 * before
    assert np.linalg.norm(run.pose.p - at.p) < 2e-3
    np.testing.assert_allclose(run.pose.R, at.R, atol=5e-3)
    speeds = np.abs(np.diff(run.sent, axis=0)) / pa10.p.period_s
    bound = pa10.p.redundancy.max_rate * pa10.p.joints.velocity
    assert (speeds <= 1.01 * bound).all()
    run.observe()


def test_six_joints_have_no_self_motion(ur5e, start):
    run = start(ur5e, ur5e.posture("ready") + 0.2)
    run.go(1.0)
    np.testing.assert_allclose(run.sent[-1], run.q, atol=1e-9)
