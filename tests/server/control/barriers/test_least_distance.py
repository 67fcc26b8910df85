"""Standing keeps every barrier, so there always is an answer, and it keeps them to rounding."""

import numpy as np
import pytest
from laboratory.campaign.kernels.wedges import Wedge, wedge
from telerobot.config.schema.surroundings import ObstacleSection
from telerobot.server.control.barriers.least_distance import least_distance
from telerobot.server.control.barriers.programme import BarrierError, nearest

from ..test_clearance import Kept

L = 0.3
WEDGES = 10_000
"""`make campaign ARGS="--only wedges"` tries more."""


def answer(drawn: Wedge):
    return nearest(*drawn[:5], L, (drawn.A, drawn.b))


def test_whatever_the_barriers_there_is_an_answer_that_keeps_them():
    rng, softened, moved = np.random.default_rng(0), 0, 0
    for _ in range(WEDGES):
        drawn = wedge(rng)
        found = answer(drawn)
        assert (drawn.A @ found.dq >= np.minimum(drawn.b, 0.0) - 1e-9).all()
        assert (found.dq >= drawn.low).all()
        assert (found.dq <= drawn.high).all()
        assert found.fallback != "barriers_stand"
        softened += found.fallback == "barriers_softened"
        moved += found.fallback == "barriers_softened" and bool(np.abs(found.dq).max() > 1e-3)
    # The solver fails at some of them; an answer is not just to stand, where more is possible.
    assert softened > 0.01 * WEDGES
    assert moved > 0.2 * softened


def test_joints_that_are_led_back_are_led_back_whatever_the_barriers():
    rng = np.random.default_rng(1)
    for _ in range(2000):
        drawn = wedge(rng, led_back=True)
        found = answer(drawn)
        assert (found.dq >= drawn.low).all()
        assert (found.dq <= drawn.high).all()
        assert np.isfinite(found.dq).all()


def test_between_opposed_barriers_the_rest_of_the_motion_goes_on(pa10, rng):
    """All that is left is in their common plane, and it is not given up."""
    J = pa10.mechanism.kinematics(pa10.posture("ready"), pa10.settings.T_wrist_mrf).J
    V, up = pa10.p.joints.velocity, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) @ J
    asked = np.linalg.pinv(J) @ np.array([0.1, 0.0, 0.1, 0.0, 0.0, 0.0])
    for _ in range(50):
        A = np.outer(np.tile([1.0, -1.0], 10) * rng.uniform(0.1, 3.0, 20), up)
        found = nearest(asked, J, -V, V, V, L, (A + 1e-13 * rng.normal(size=A.shape), np.zeros(20)))
        x = J @ found.dq
        assert abs(x[2]) < 1e-8
        assert x[0] > 0.04


def test_the_least_distance_is_the_least(rng):
    """Nothing else that is inside all bounds is nearer: x (z − x) ≥ 0 for all z there."""
    for _ in range(200):
        m, n = int(rng.integers(1, 30)), int(rng.integers(2, 8))
        G = rng.normal(size=(m, n))
        G /= np.linalg.norm(G, axis=1)[:, None]
        inside = rng.normal(size=n)
        h = G @ inside - rng.uniform(0.0, 1.0, m) * (rng.random(m) < 0.8)
        x = least_distance(G, h)
        assert (G @ x >= h - 1e-11).all()
        for way in rng.normal(size=(50, n)):
            closing, room = -(G @ way), G @ inside - h
            far = (room[closing > 0] / closing[closing > 0]).min(initial=10.0)
            for z in (inside, inside + far * way):
                assert x @ (z - x) >= -1e-9


@pytest.mark.parametrize("name", ["dq", "J", "slopes", "least"])
def test_what_is_not_a_number_is_not_taken_for_an_order_to_stand(pa10, name):
    V = pa10.p.joints.velocity
    given = {
        "dq": 0.1 * V,
        "J": pa10.mechanism.kinematics(pa10.posture("ready"), pa10.settings.T_wrist_mrf).J,
        "slopes": np.ones((1, 7)),
        "least": np.zeros(1),
    }
    given[name] = np.full_like(given[name], np.nan)
    with pytest.raises(BarrierError, match="not finite"):
        nearest(given["dq"], given["J"], -V, V, V, L, (given["slopes"], given["least"]))


def around(kept: Kept, rng: np.random.Generator) -> tuple[ObstacleSection, ...]:
    """Return things in pairs on opposite sides of links, nearer than they may be or in them."""
    ends = kept.guard.capsules.place(kept.run.q[None]).ends[0].reshape(-1, 2, 3)
    found = []
    for i in range(int(rng.integers(2, 8))):
        one, other = ends[int(rng.integers(1, len(ends)))]
        share, radius = rng.random(), float(rng.uniform(0.02, 0.1))
        way = rng.normal(size=3)
        way *= rng.uniform(0.0, 0.2) / np.linalg.norm(way)
        for side, sign in enumerate((1.0, -1.0)):
            xyz = tuple(((1.0 - share) * one + share * other + sign * way).tolist())
            shape = str(rng.choice(["sphere", "capsule", "box"]))
            to = (xyz[0], xyz[1], xyz[2] + 0.3)
            size = {
                "sphere": {"radius": radius},
                "capsule": {"radius": radius, "to": to},
                "box": {"half_size": (radius,) * 3},
            }[shape]
            found.append(ObstacleSection(name=f"thing_{i}_{side}", shape=shape, xyz=xyz, **size))
    return tuple(found)


def test_among_things_on_both_sides_of_its_links_no_tick_raises(pa10):
    limits = set()
    for seed in range(40, 64):
        rng = np.random.default_rng(seed)
        kept = Kept(pa10, around(Kept(pa10, ()), rng))
        for _ in range(4):
            kept.go(0.2, (0.5 * rng.normal(size=6)).tolist())
        kept.run.observe()
        limits |= {name for output in kept.run.outputs for name in output.limits}
    # The telemetry tells where the solver was helped.
    assert "barriers_softened" in limits
