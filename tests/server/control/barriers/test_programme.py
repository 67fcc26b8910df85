import numpy as np
import pytest
from telerobot.server.control.barriers import programme as nearest_module
from telerobot.server.control.barriers.programme import ATTITUDE, SLIDE, nearest, of_tools
from telerobot.server.control.barriers.together import PayloadLink

L = 0.3
W = np.diag([1.0] * 3 + [L] * 3)


def jacobian(arm, q):
    return arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf).J


def rates_for(J, twist):
    return np.linalg.pinv(J) @ twist


def turned(J, found, asked):
    """Angle between the weighted tool motion asked for and the one found [rad]."""
    a, b = W @ J @ asked, W @ J @ found
    return np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1))


def test_rates_inside_all_bounds_stay_what_they_are(arm, rng):
    V = arm.p.joints.velocity
    for _ in range(50):
        dq = rng.uniform(-V, V)
        found = nearest(dq, jacobian(arm, arm.random_posture(rng)), -V, V, V, L)
        np.testing.assert_allclose(found.dq, dq, atol=1e-6)
        assert found.share == pytest.approx(1.0, abs=1e-6)


def test_every_answer_is_inside_the_box(arm, rng):
    V = arm.p.joints.velocity
    for _ in range(200):
        low = -V * rng.uniform(-0.1, 1.0, arm.p.n)
        high = np.maximum(low, V * rng.uniform(-0.1, 1.0, arm.p.n))
        found = nearest(rng.uniform(-V, V), jacobian(arm, arm.random_posture(rng)), low, high, V, L)
        assert (found.dq >= low).all()
        assert (found.dq <= high).all()
        assert -1e-9 <= found.share <= 1.0 + 1e-9


def test_nothing_but_zero_is_left_where_nothing_is_allowed(arm, rng):
    none = np.zeros(arm.p.n)
    J = jacobian(arm, arm.posture("ready"))
    assert not nearest(rng.normal(size=arm.p.n), J, none, none, arm.p.joints.velocity, L).dq.any()


def test_seven_joints_keep_the_tool_on_its_way_when_one_of_them_is_blocked(pa10, rng):
    """Self-motion is spent first, where the other six can do it: here all but s2, e1, e2, w1."""
    V, J = pa10.p.joints.velocity, jacobian(pa10, pa10.posture("ready") + 0.2)
    for _ in range(20):
        twist = rng.normal(size=6) * [0.05, 0.05, 0.05, 0.1, 0.1, 0.1]
        dq = rates_for(J, twist)
        for joint in (0, 2, 6):
            low, high = -10 * V, 10 * V
            low[joint] = high[joint] = 0.0
            found = nearest(dq, J, low, high, V, L)
            assert found.dq[joint] == 0.0
            assert found.share > 0.9
            assert turned(J, found.dq, dq) < np.deg2rad(1)


def test_six_joints_slow_down_before_they_leave_the_way(ur5e, rng):
    """One joint may do only half of what is asked: slower, and still in the same direction."""
    V = ur5e.p.joints.velocity
    for _ in range(50):
        q = ur5e.posture("ready") + rng.uniform(-0.2, 0.2, 6)
        J = jacobian(ur5e, q)
        dq = rates_for(J, rng.normal(size=6) * [0.05, 0.05, 0.05, 0.15, 0.15, 0.15])
        joint = int(np.argmax(np.abs(dq) / V))
        low, high = -V, V.copy()
        (low if dq[joint] < 0 else high)[joint] = 0.5 * dq[joint]
        found = nearest(dq, J, low, high, V, L)
        assert 0.45 < found.share < 0.9
        assert turned(J, found.dq, dq) < np.deg2rad(5)


def test_a_joint_that_leads_away_from_its_bound_is_not_held(arm, rng):
    """Another joint's bound may slow the way, it never turns a joint round."""
    V, J = arm.p.joints.velocity, jacobian(arm, arm.posture("ready"))
    for _ in range(50):
        dq = rng.uniform(-0.5, 0.5, arm.p.n) * V
        # Every joint is at the bound that it leads away from.
        found = nearest(dq, J, np.where(dq > 0, 0.0, -V), np.where(dq > 0, V, 0.0), V, L)
        np.testing.assert_allclose(found.dq, dq, atol=1e-6)


@pytest.mark.parametrize("left", [0.5, 0.3, 0.0])
def test_where_slowing_is_not_enough_only_what_approaches_is_given_up(ur5e, rng, left):
    """Six joints have no self-motion: the slowed tool motion, projected on the barrier.

    The less is `left` of the approach, the less slow it is.
    """
    V, M = 10.0 * ur5e.p.joints.velocity, np.diag([1.0] * 3 + [(ATTITUDE * L) ** 2] * 3)
    for _ in range(50):
        J = jacobian(ur5e, ur5e.posture("ready") + rng.uniform(-0.2, 0.2, 6))
        x = rng.normal(size=6) * [0.05, 0.05, 0.05, 0.15, 0.15, 0.15]
        dq = rates_for(J, x)
        # A gap with slope n along the tool's motion, which closes it more or less obliquely.
        n = -M @ x / np.sqrt(x @ M @ x) + rng.normal(size=6) * [1.0, 1.0, 1.0, 0.9, 0.9, 0.9]
        if n @ x > -0.3 * np.sqrt((x @ M @ x) * (n @ np.linalg.solve(M, n))):
            continue
        found = nearest(dq, J, -V, V, V, L, (n[None] @ J, np.array([left * (n @ x)])))
        turn, pace = np.linalg.solve(M, n), 1.0 - left
        expected = pace * x - turn * ((pace - left) * (n @ x) / (n @ turn))
        np.testing.assert_allclose(J @ found.dq, expected, atol=0.02 * np.linalg.norm(x))
        assert n @ J @ found.dq > left * (n @ x) - 2e-4
        assert found.pace == pytest.approx(pace, abs=0.02)
        assert found.share <= found.pace


def test_a_motion_straight_at_a_barrier_is_all_given_up(ur5e, rng):
    V, M = 10.0 * ur5e.p.joints.velocity, np.diag([1.0] * 3 + [(ATTITUDE * L) ** 2] * 3)
    J = jacobian(ur5e, ur5e.posture("ready"))
    x = rng.normal(size=6) * [0.05, 0.05, 0.05, 0.15, 0.15, 0.15]
    found = nearest(rates_for(J, x), J, -V, V, V, L, (-(M @ x)[None] @ J, np.zeros(1)))
    assert np.linalg.norm(J @ found.dq) < 0.01 * np.linalg.norm(x)
    assert found.share < 0.01


def test_the_answer_does_not_jump_where_sliding_begins(ur5e, rng):
    V, J = 10.0 * ur5e.p.joints.velocity, jacobian(ur5e, ur5e.posture("ready"))
    x = rng.normal(size=6) * [0.05, 0.05, 0.05, 0.15, 0.15, 0.15]
    dq, n = rates_for(J, x), rng.normal(size=6)
    n *= -np.sign(n @ x)
    allowed = np.linspace(1.1, 0.0, 400) * (n @ x)
    every = np.array([nearest(dq, J, -V, V, V, L, (n[None] @ J, b[None])).dq for b in allowed])
    steps = np.linalg.norm(np.diff(every, axis=0) @ J.T, axis=1)
    assert steps.max() < 0.05 * np.linalg.norm(x)


def test_a_gap_is_widened_as_told_where_that_closes_no_other(pa10, rng):
    V, J = pa10.p.joints.velocity, jacobian(pa10, pa10.posture("ready"))
    for _ in range(20):
        slopes = rng.normal(size=(2, 7)) * 0.3
        found = nearest(rates_for(J, rng.normal(size=6) * 0.02), J, -V, V, V, L,
                        (slopes[:1], np.array([0.01])))  # fmt: skip
        assert slopes[0] @ found.dq > 0.008
        # One that opens only as the other closes, and one that nothing opens.
        against = np.array([slopes[0], -slopes[0], np.zeros(7)])
        found = nearest(rates_for(J, rng.normal(size=6) * 0.02), J, -V, V, V, L,
                        (against, np.array([0.02, 0.0, 0.02])))  # fmt: skip
        assert abs(slopes[0] @ found.dq) < 1e-6


@pytest.mark.parametrize("tool", [[0] * 7, [0, 0, 0, 1, 1, 1, 1], [1, 0, 2, 1, 0, 2, 2]])
def test_the_programme_has_the_costs_that_are_stated(rng, tool):
    n, length, tool = 7, 0.4, np.array(tool)
    tools = tool.max() + 1
    dq, J, V = rng.normal(size=n), rng.normal(size=(6, n)), rng.uniform(0.5, 2.0, n)
    low, high, slopes = -V, V, rng.normal(size=(3, n))
    least = np.array([-0.2, 0.01, -0.1])
    costs = rng.uniform(1.0, 1e4, tools)
    posed = (
        dq,
        of_tools(J, tool),
        tool,
        low,
        high,
        V,
        slopes,
        least,
        np.minimum(least, 0.0),
        costs,
        length,
    )
    H, f, A, upper, lower, sense = nearest_module._programme(*posed)
    weight = np.diag([1.0] * 3 + [length] * 3)
    for _ in range(10):
        z = rng.normal(size=len(f))
        rates, shares, short = z[:n], z[n : n + tools], z[n + tools :]
        cost = costs.min() * short @ short
        for t, s in enumerate(shares):
            of_tool = tool == t
            asked, found, own_J = dq[of_tool], rates[of_tool], J[:, of_tool]
            aside = weight @ own_J @ (found - s * asked)
            cost += nearest_module.LEAVE_PATH * aside @ aside
            cost += nearest_module.SELF_MOTION * np.sum(((found - s * asked) / V[of_tool]) ** 2)
            slow = nearest_module.SLOW_DOWN * np.sum((weight @ own_J @ asked) ** 2) + 1e-9
            slow += nearest_module.SELF_MOTION * np.sum((asked / V[of_tool]) ** 2)
            cost += slow * ((1.0 - s) ** 2 - 1.0)
        assert 0.5 * z @ H @ z + f @ z == pytest.approx(0.5 * cost, rel=1e-9)
        np.testing.assert_allclose(A @ z, [*(slopes @ rates), slopes[1] @ rates + short[0]])
    shares = [nearest_module.SLIDE] * tools
    for slope, left, widened in zip(slopes, [0.2, 0.0, 0.1], [0.0, 0.01, 0.0], strict=True):
        if slope @ dq < -left:
            for t in set(tool[slope != 0.0].tolist()):
                shares[t] = max(shares[t], 1.0 + (left + widened) / (slope @ dq))
    np.testing.assert_array_equal(lower, [*low, *shares, 0.0, -0.2, 0.0, -0.1, 0.01])
    np.testing.assert_array_equal(upper[: n + tools], [*high, *([1.0] * tools)])
    assert not sense.any()


def test_tools_that_nothing_couples_go_as_each_would_alone(rng):
    """And one that a barrier slows does not slow the other."""
    tool = np.repeat([0, 1], 7)
    for _ in range(20):
        dq, J, V = rng.normal(size=14), rng.normal(size=(6, 14)), rng.uniform(0.5, 2.0, 14)
        slope = np.concatenate([rng.normal(size=7), np.zeros(7)])[None]
        rows = (slope, np.array([0.5 * min(float(slope[0] @ dq), 0.0) - 1e-3]))
        both = nearest(dq, J, -3 * V, 3 * V, V, L, rows, tool)
        for t in range(2):
            of = slice(7 * t, 7 * t + 7)
            own = (rows[0][:, of], rows[1])
            alone = nearest(dq[of], J[:, of], -3 * V[of], 3 * V[of], V[of], L, own)
            np.testing.assert_allclose(both.dq[of], alone.dq, atol=1e-5)
            assert both.share[t] == pytest.approx(alone.share[0], abs=1e-5)
            assert both.pace[t] == pytest.approx(alone.pace[0], abs=1e-5)


@pytest.mark.parametrize("side", ["low", "high"])
def test_barriers_are_soft_only_where_a_joint_is_led_back(rng, side):
    n = 7
    dq, J, V = rng.normal(size=n), rng.normal(size=(6, n)), rng.uniform(0.5, 2.0, n)
    low, high, slopes = -V, V, rng.normal(size=(3, n))
    if side == "low":
        low[2] = 0.01
    else:
        high[2] = -0.01
    least = np.array([-0.2, 0.01, -0.1])
    tool, kept = np.zeros(n, dtype=np.int64), np.minimum(least, 0.0)
    *_, sense = nearest_module._programme(
        dq, of_tools(J, tool), tool, low, high, V, slopes, least, kept, np.ones(1), 0.4
    )
    # The rates, the share and what widening falls short by; three barriers, and the widening.
    np.testing.assert_array_equal(sense, [0] * (n + 2) + [8] * 3 + [0])


# --- the solver is not trusted ----------------------------------------------------------------


class Solver:
    """Stands before DAQP: the first answers are others, as a function of DAQP's own makes them."""

    def __init__(self, monkeypatch, *instead):
        self._real, self._instead, self.senses = nearest_module.daqp.solve, list(instead), []
        monkeypatch.setattr(nearest_module.daqp, "solve", self.solve)

    def solve(self, H, f, A, upper, lower, sense):
        self.senses.append(sense.copy())
        answer = self._real(H, f, A, upper, lower, sense)
        return self._instead.pop(0)(*answer) if self._instead else answer


def failed(found, value, _flag, info):
    return found, value, -1, info


def off_by(amount, joint=0):
    def changed(found, value, flag, info):
        found = np.array(found)
        found[joint] += amount
        return found, value, flag, info

    return changed


UNIT = np.eye(6)
"""A tool each of whose axes has a joint of its own."""
RATE = np.array([0.1, 0.05, 0.0, 0.1, 0.0, 0.2])
WALL = -np.eye(6)[:1], np.array([-0.02])
"""The first joint may go at 0.02 at most."""


def before_a_wall(low=-1.0, high=1.0):
    low, high = np.full(6, low), np.full(6, high)
    return nearest(RATE, UNIT, low, high, np.ones(6), L, WALL)


def test_a_solver_that_finds_nothing_is_asked_once_more_with_soft_barriers(monkeypatch):
    expected = before_a_wall()
    solver = Solver(monkeypatch, failed)
    found = before_a_wall()
    # Six rates and the share; then the barrier, which alone is soft.
    assert [sense.tolist() for sense in solver.senses] == [[0] * 8, [0] * 7 + [8]]
    assert found.fallback == "barriers_softened"
    assert found.dq[0] <= 0.02 + 1e-9
    np.testing.assert_allclose(found.dq, expected.dq, atol=0.02)


@pytest.mark.parametrize("second", [failed, off_by(np.nan), off_by(np.nan, 6)])
def test_where_it_finds_nothing_then_either_the_arm_stands(monkeypatch, second):
    solver = Solver(monkeypatch, failed, second)
    found = before_a_wall()
    assert len(solver.senses) == 2
    assert found.fallback == "barriers_stand"
    np.testing.assert_array_equal(found.dq, np.zeros(6))
    assert found.pace == SLIDE
    assert found.share == 0.0


@pytest.mark.parametrize(("low", "high", "rate"), [(0.01, 1.0, 0.01), (-1.0, -0.03, -0.03)])
def test_where_joints_are_led_back_they_are_led_back_then_and_no_more(monkeypatch, low, high, rate):
    Solver(monkeypatch, failed, failed)
    found = before_a_wall(low, high)
    assert found.fallback == "barriers_stand"
    np.testing.assert_array_equal(found.dq, np.full(6, rate))


@pytest.mark.parametrize(
    ("beyond", "asked", "fallback"),
    [(0.5e-9, 1, ""), (1e-8, 1, ""), (1.9e-6, 1, ""), (3e-6, 2, "barriers_softened"),
     (np.nan, 2, "barriers_softened")],
)  # fmt: skip
def test_a_barrier_that_the_solver_broke_is_mended_or_it_is_asked_again(
    monkeypatch, beyond, asked, fallback
):
    off = before_a_wall().dq[0] - 0.02
    solver = Solver(monkeypatch, off_by(beyond - off))
    found = before_a_wall()
    assert len(solver.senses) == asked
    assert found.fallback == fallback
    assert found.dq[0] <= 0.02 + 1.1e-9
    if beyond == 1e-8:  # mended, and not just taken
        assert found.dq[0] <= 0.02 + 2e-10


@pytest.mark.parametrize("joint", [1, 5])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_where_a_joint_is_led_back_a_broken_barrier_is_taken_as_it_is(monkeypatch, side, joint):
    """Barriers are soft then: the joint's own bounds are not."""
    low, high = -np.ones(6), np.ones(6)
    (low if side > 0 else high)[joint] = side * 0.01
    solver = Solver(monkeypatch, off_by(0.05))
    found = nearest(RATE, UNIT, low, high, np.ones(6), L, WALL)
    assert len(solver.senses) == 1
    assert found.fallback == ""
    assert found.dq[0] > 0.021
    assert side * found.dq[joint] >= 0.01


@pytest.mark.parametrize("bound", ["low", "high"])
def test_a_joint_that_may_just_not_go_on_is_not_led_back(monkeypatch, bound):
    low, high = -np.ones(6), np.ones(6)
    (low if bound == "low" else high)[3] = 0.0
    solver = Solver(monkeypatch, off_by(0.05))
    found = nearest(RATE, UNIT, low, high, np.ones(6), L, WALL)
    assert len(solver.senses) == 2
    assert found.dq[0] <= 0.02 + 1e-9


@pytest.mark.parametrize("led_back", [False, True])
@pytest.mark.parametrize("name", ["dq", "J", "low", "high", "slopes", "least"])
def test_one_number_that_is_none_is_told_by_name(name, led_back):
    """And is not taken for an order to stand, nor for a bound that is far away."""
    given = {"dq": RATE.copy(), "J": UNIT.copy(), "low": -np.ones(6), "high": np.ones(6),
             "slopes": WALL[0].copy(), "least": WALL[1].copy()}  # fmt: skip
    given["low"][5] = 0.01 if led_back else -1.0
    given[name].flat[0] = np.nan
    with pytest.raises(nearest_module.BarrierError, match=f"^{name} is not finite"):
        nearest(given["dq"], given["J"], given["low"], given["high"], np.ones(6), L,
                (given["slopes"], given["least"]))  # fmt: skip


def test_a_bound_that_is_infinitely_far_away_binds_nothing():
    found = nearest(RATE, UNIT, np.full(6, -np.inf), np.full(6, np.inf), np.ones(6), L)
    np.testing.assert_allclose(found.dq, RATE, atol=1e-6)


def test_wheels_keep_the_proportion_that_they_are_asked_for():
    dq = np.array([0.4, 0.2, 0.1, 0.0, 0.1, 0.0])
    wall = -np.eye(6)[:1], np.array([-0.1])
    found = nearest(dq, UNIT, -np.ones(6), np.ones(6), np.ones(6), L, wall, wheels=(0,))
    assert found.dq[0] <= 0.1 + 1e-9
    assert found.dq[0] == pytest.approx(2.0 * found.dq[1])
    assert found.dq[0] > 0.05


def test_each_gap_is_widened_at_the_least_cost_of_the_tools_that_it_concerns(rng):
    tool, costs = np.array([0, 0, 1, 1, 2, 2]), np.array([30.0, 20.0, 10.0])
    slopes = np.array([
        [1.0, 0.5, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.3, 1.0, 0.2, 0.0],
        [0.0] * 6, [0.4, 0.0, 0.6, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.7, 0.0],
    ])  # fmt: skip
    least, none = np.array([0.01, 0.02, 0.03, 0.04, 0.0]), np.zeros(5)
    H, f, A, upper, lower, sense = nearest_module._programme(
        RATE, of_tools(UNIT, tool), tool, -np.ones(6), np.ones(6), np.ones(6), slopes, least, none,
        costs, L,
    )  # fmt: skip
    # Six rates, three shares, and what each of the four gaps falls short by.
    assert H.shape == (13, 13)
    np.testing.assert_array_equal(np.diag(H)[9:], [30.0, 10.0, 30.0, 20.0])
    np.testing.assert_array_equal(H[9:, :9], 0.0)
    np.testing.assert_array_equal(H[9:, 9:], np.diag(np.diag(H)[9:]))
    np.testing.assert_array_equal(f[9:], 0.0)
    np.testing.assert_array_equal(A[:5, :6], slopes)
    np.testing.assert_array_equal(A[5:, :6], slopes[:4])
    np.testing.assert_array_equal(A[5:, 9:], np.eye(4))
    np.testing.assert_array_equal(A[:5, 6:], 0.0)
    np.testing.assert_array_equal(lower[13:], [0.0] * 5 + [0.01, 0.02, 0.03, 0.04])
    np.testing.assert_array_equal(lower[9:13], 0.0)
    assert (upper[9:] >= 1e30).all()
    assert not sense.any()
    # A joint that may stand still, and no further, is none that is led back.
    low, high = -np.ones(6), np.ones(6)
    low[0] = high[1] = 0.0
    *_, sense = nearest_module._programme(
        RATE, of_tools(UNIT, tool), tool, low, high, np.ones(6), slopes, least, none, costs, L
    )
    assert not sense.any()


def test_what_is_left_of_a_motion_is_its_size_with_rotations_by_their_length():
    length, J = 0.5, UNIT[None]
    asked = np.array([0.3, 0.0, -0.4, 0.0, 2.0, 0.0])  # 0.5 m/s and 2 rad/s: √(0.25 + 1)
    for found, size in (
        (np.array([0.3, 0.0, -0.4, 0.0, 0.0, 0.0]), 0.5),
        (np.array([0.0, 0.0, 0.0, 0.0, 2.0, 0.0]), 1.0),
        (np.array([0.0, 0.0, 0.0, 0.4, 0.0, 0.0]), 0.2),
    ):
        granted, share, pace = nearest_module._granted(
            np.array([*found, 0.95]), asked, J, -np.full(6, 9.0), np.full(6, 9.0), length
        )
        np.testing.assert_array_equal(granted, found)
        assert share == pytest.approx(size / np.sqrt(1.25))
        assert pace == 0.95
    # Of a motion that is none, the share is the one it may go on at.
    for asked, share_is in ((1e-9, 0.0), (0.9e-9, 0.95)):
        _, share, _ = nearest_module._granted(
            np.array([0.0] * 6 + [0.95]), asked * np.eye(6)[0], J, -np.full(6, 9.0),
            np.full(6, 9.0), length,
        )  # fmt: skip
        assert share == share_is


def test_a_tool_that_may_stay_widens_a_gap_only_as_far_as_that_is_worth_it():
    """Along the one way that opens it: the slope of 1 against leaving the place, 1000 to 10."""
    gap = np.eye(6)[:1], np.array([0.1])
    none = np.zeros(6)
    told = nearest(none, UNIT, -np.ones(6), np.ones(6), np.ones(6), L, gap)
    beside = nearest(none, UNIT, -np.ones(6), np.ones(6), np.ones(6), L, gap,
                     widen=[nearest_module.WIDEN_BESIDE])  # fmt: skip
    for found, cost in ((told, 1e4), (beside, 10.0)):
        expected = 0.1 * cost / (cost + 1000.0 + 0.05)
        assert found.dq[0] == pytest.approx(expected, rel=1e-4)


def test_a_gap_that_may_close_does_not_hold_what_opens_another():
    """Both are to open, along one joint: the one that is to open faster does, the other closes."""
    rows = np.array([UNIT[0], -UNIT[0]]), np.array([0.2, 0.1])
    none, one = np.zeros(6), np.ones(6)
    held = nearest(none, UNIT, -one, one, one, L, rows)
    assert abs(held.dq[0]) < 1e-6
    found = nearest(none, UNIT, -one, one, one, L, rows, kept=np.array([0.0, -0.3]))
    # Where both fall as far short: (0.2 − 0.1) / 2.
    assert found.dq[0] == pytest.approx(0.05, rel=0.1)
    # What neither leaves room for stands, and no gap closes faster than it may.
    for kept in ([0.0, -0.02], [0.0, 0.0], [-0.02, 0.0]):
        found = nearest(none, UNIT, -one, one, one, L, rows, kept=np.array(kept))
        assert (np.array([1.0, -1.0]) * found.dq[0] >= np.array(kept) - 1e-9).all()


def test_tools_on_one_payload_have_one_share():
    link = PayloadLink(np.array([0, 1]), np.zeros((2, 6)))
    both, tool = np.concatenate([UNIT, UNIT], axis=1), np.repeat([0, 1], 6)
    wall = -np.eye(12)[:1], np.array([-0.06])
    rates = np.concatenate([RATE, RATE])
    found = nearest(rates, both, -np.ones(12), np.ones(12), np.ones(12), L, wall, tool, (link,))
    assert found.pace[0] == found.pace[1]
    assert SLIDE < found.pace[0] < 0.95
    alone = nearest(rates, both, -np.ones(12), np.ones(12), np.ones(12), L, wall, tool)
    assert alone.pace[1] > 0.99


@pytest.mark.parametrize("bound", [-0.06, -0.005])
def test_a_payload_goes_as_fast_beside_what_is_near_to_either_arm(bound):
    link = PayloadLink(np.array([0, 1]), np.zeros((2, 6)))
    both, tool = np.concatenate([UNIT, UNIT], axis=1), np.repeat([0, 1], 6)
    rates, ones = np.concatenate([RATE, RATE]), np.ones(12)
    paces = [
        nearest(
            rates, both, -ones, ones, ones, L,
            (-np.eye(12)[[joint]], np.array([bound])), tool, (link,),
        ).pace[0]
        for joint in (0, 6)
    ]  # fmt: skip
    assert paces[0] == pytest.approx(paces[1], abs=1e-6)


def test_every_tool_widens_its_gaps_where_nothing_else_is_said():
    gap = np.eye(12)[11:], np.array([0.1])
    both, tool = np.concatenate([UNIT, UNIT], axis=1), np.repeat([0, 1], 6)
    found = nearest(np.zeros(12), both, -np.ones(12), np.ones(12), np.ones(12), L, gap, tool)
    assert found.dq[11] > 0.09


def test_a_joint_that_moves_two_tools_and_may_not_move_is_made_up_for_by_the_others_of_both():
    """Both tools keep their twists; where the programme knows of one alone, it bends the other."""
    rng, n = np.random.default_rng(4), 16
    tool, shared = np.repeat([0, 0, 1], [2, 7, 7]), np.arange(n) < 2
    J = np.zeros((2, 6, n))
    for t in range(2):
        J[t][:, shared | (tool == t)] = rng.normal(size=(6, 9))
    J[1][:, (tool == 0) & ~shared] = 0.0
    dq, most = 0.05 * rng.normal(size=n), np.full(n, 3.0)
    high = np.where(shared, 0.0, most)
    found = nearest(dq, J, -high, high, most, L, None, tool).dq
    assert not found[shared].any()
    for own in J:
        assert own @ found == pytest.approx(own @ dq, rel=0.02, abs=1e-3)
    alone = J[tool, :, np.arange(n)].T
    blind = nearest(dq, alone, -high, high, most, L, None, tool).dq
    assert np.abs(J[1] @ (blind - dq)).max() > 0.02


def test_tools_with_joints_of_their_own_may_be_told_by_these_alone():
    rng, n = np.random.default_rng(7), 14
    tool, most = np.repeat([0, 1], 7), np.full(14, 3.0)
    J, dq = rng.normal(size=(6, n)), 0.1 * rng.normal(size=n)
    low, high = -most, most.copy()
    high[3] = low[9] = 0.0
    whole = np.zeros((2, 6, n))
    whole[0, :, :7], whole[1, :, 7:] = J[:, :7], J[:, 7:]
    by_columns = nearest(dq, J, low, high, most, L, None, tool)
    assert (by_columns.dq == nearest(dq, whole, low, high, most, L, None, tool).dq).all()
