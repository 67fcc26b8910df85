"""A rail advances a snake's foot: the same joints come deeper, and out again if the rail locks."""

import numpy as np
import pytest
from laboratory.oracle.arm import OracleArm
from laboratory.oracle.tunnel import Tunnel
from telerobot.config.load import altered, load_cell
from telerobot.server.control.backbone.insertion import Backbone

DEEPEST = 1.5 - 0.63
"""Of `snake`, whose foot stands [m]."""


@pytest.fixture(scope="module")
def fed():
    """Make `snake_feed` start at a free length [m]."""
    cell = load_cell("snake_feed")
    fits = Backbone.from_cell(cell)

    def start(s1):
        q = fits.fits[int(np.abs(fits.lengths - s1).argmin())]
        return altered(cell, {"mechanism.postures": dict.fromkeys(("start", "ready"), tuple(q))})

    return start


def links_of(cell, truth):
    """Return the true places of all joints that turn, and the tip (31, 3) [m]."""
    return OracleArm.of(cell).frames(np.array(truth.q))[2:, :3, 3]


def test_it_comes_deeper_than_a_foot_that_stands_and_touches_nothing(play, fed):
    cell = fed(0.60)
    run = play(
        {"at_s": 0.2, "cmd/drive": {"rates": [0.08]}},
        {"at_s": 3.6, "cmd/drive": {"rates": [-0.08]}},
        seconds=4.6,
        cell=cell,
    )
    assert run.summary["mode"] == "enabled"
    assert run.summary["wall_force_n"] == 0.0
    assert run.summary["limit_violations"] == 0
    assert run.summary["deepest_m"] > DEEPEST + 0.24
    tunnel, feeds = Tunnel(cell.config.mechanism.backbone), []
    for truth in run.truths[::10]:
        links = links_of(cell, truth)
        feeds.append(truth.q[0])
        assert links[0] == pytest.approx([0.0, truth.q[0], 0.0], abs=1e-12)
        assert tunnel.off_centre(np.concatenate((links, 0.5 * (links[1:] + links[:-1])))) < 6e-3
    assert max(feeds) == pytest.approx(0.4, abs=3e-3)
    assert min(feeds) == pytest.approx(0.318, abs=3e-3)


@pytest.mark.parametrize("s1", [0.9, 0.5])
def test_with_the_rail_locked_the_arm_bends_around_it_out_to_the_entrance(play, fed, s1):
    cell = fed(s1)
    run = play(
        {"at_s": 0.1, "cmd/drive": {"rates": [0.08]}},
        {"at_s": 0.5, "rig/fault": {"kind": "block", "target": "feed"}},
        {"at_s": 1.5, "operator/mode": {"action": "resume"}},
        {"at_s": 1.6, "cmd/drive": {"rates": [-0.08]}},
        seconds=2.0 + (1.5 - s1) / 0.08,
        cell=cell,
    )
    (locked,) = run.events("joint_locked")
    assert locked.values["joint"] == "feed"
    assert run.states[-1].insertion["depth"] < 0.06
    assert "locked:feed" in run.states[-1].limits
    assert np.ptp([truth.q[0] for truth in run.truths[-500:]]) < 2e-3
    assert run.summary["wall_force_n"] == 0.0
    # 3.4 mm, or 1.49 with the kernels that OpenBLAS takes on processors with AVX-512.
    assert run.summary["min_clearance_m"] > 0.001
    assert run.summary["limit_violations"] == 0
