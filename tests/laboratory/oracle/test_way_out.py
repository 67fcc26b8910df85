"""The search for a way out: it finds narrow ones, and none where there is none."""

import numpy as np
import pytest
from laboratory.campaign.scenes.clutter import make_clutter
from laboratory.campaign.scenes.movers import PROMISE
from laboratory.oracle.way_out import Programme, closed_in, solved, way_out
from telerobot.config.load import Cell, load_cell
from telerobot.drivers.rig.physics.world import World

CORNERED = np.array([0.83559, 0.42116, 0.15615, 2.38108, -0.93395, -1.61191, 1.01884])
"""The arm of scene 543, which its stick and three movers led into a corner (7,) [rad] …"""
MOVERS = {
    "mover0": (0.080514, -0.028460, 0.776880),
    "mover1": (0.190028, 0.320377, 0.532246),
    "mover2": (0.325009, 0.219335, 0.346007),
}
"""… of these, 3.0 to 5.6 mm away, and of its fourth joint's limit; in World [m]."""


def _scene(seed: int, movers: dict[str, tuple[float, float, float]]) -> tuple[Cell, World]:
    cell = make_clutter(load_cell("pa10"), seed).cell
    world = World(cell)
    for name, xyz in movers.items():
        world.place(name, np.array(xyz))
    return cell, world


@pytest.fixture(scope="module")
def corner() -> tuple[Cell, World]:
    return _scene(543, MOVERS)


def test_no_way_leads_out_of_a_corner_on_which_no_gap_closes(corner: tuple[Cell, World]) -> None:
    assert closed_in(*corner, [CORNERED], PROMISE)


def test_the_search_finds_a_way_that_is_a_fraction_of_a_millimetre_wide(
    corner: tuple[Cell, World],
) -> None:
    """The same corner, where every gap may close by half a millimetre."""
    assert way_out(*corner, CORNERED, PROMISE, held=5e-4)


@pytest.mark.parametrize(
    ("seed", "q", "movers"),
    [
        (
            71,
            (-1.12137, 0.89951, 1.30357, 2.37976, 0.46051, -1.52468, -0.41186),
            {
                "mover0": (0.30829, -0.03616, 0.54900),
                "mover1": (0.15898, -0.05284, 0.80077),
                "mover2": (0.33539, -0.15665, 0.30034),
            },
        ),
        (
            823,
            (0.91409, 1.13376, 0.10137, 2.38110, 0.67273, -0.73805, 0.97849),
            {"mover0": (0.29894, 0.22337, 0.14172)},
        ),
    ],
    ids=["straight", "wider"],
)
def test_a_way_that_one_aim_leads_along_hangs_on_no_draw(seed, q, movers) -> None:
    """A tree that grew at random alone found none from the first with four of six draws."""
    assert way_out(*_scene(seed, movers), np.array(q), PROMISE, draws=())


def test_an_arm_is_closed_in_only_if_none_of_its_postures_has_a_way_out(
    corner: tuple[Cell, World],
) -> None:
    cell, _ = corner
    start = np.array(cell.config.mechanism.postures["start"])
    assert not closed_in(cell, World(cell), [start, CORNERED], PROMISE)


def test_what_is_solved_is_the_nearest_of_all_that_keep_the_bounds() -> None:
    """Nothing allowed is beyond the plane through it that is square to its way (convexity)."""
    rng = np.random.default_rng(3)
    box = np.full(4, 0.8)
    for _ in range(50):
        A, wish = rng.normal(size=(9, 4)), rng.normal(size=4)
        least = -rng.uniform(0.0, 0.5, 9)
        x = solved(Programme.nearest(wish)._replace(A=A, least=least), -box, box)
        assert (A @ x >= least - 1e-7).all()
        assert (np.abs(x) <= box + 1e-9).all()
        others = np.clip(rng.normal(scale=0.3, size=(2000, 4)), -box, box)
        others = others[(others @ A.T >= least).all(axis=1)]
        assert len(others) > 0
        assert ((others - x) @ (wish - x) <= 1e-7).all()
