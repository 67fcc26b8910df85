"""What arms bear of one payload is judged before its load is shared out anew."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.spatial import Pose
from telerobot.server.stability.loads import Carried, SharedLoad

EVEN, DEAR = np.ones((2, 6)), np.array([[3.0] * 6, [1.0] * 6])


@pytest.fixture(scope="module")
def judge():
    cell = load_cell("pa10_pair")
    return SharedLoad(cell.joint_tasks[0], cell.parts)


@pytest.fixture(scope="module")
def carried():
    q = tuple(np.array(p.config.mechanism.postures["start"]) for p in load_cell("pa10_pair").parts)
    return lambda mass, T=None: Carried(mass, np.zeros(3), T or Pose.identity(), q)


def test_what_the_payload_was_found_to_weigh_is_judged_and_not_what_was_told(judge, carried):
    assert judge.refusal(DEAR, EVEN, carried(5.0)) is None
    # 12 kg in shares of 30 and 70 % take 19 N·m at the right grasp.
    assert judge.refusal(DEAR, EVEN, carried(12.0)).startswith("right: axis Tx of its sensor reads")


def test_a_rated_payload_is_named(judge, carried):
    light = np.array([[10.0] * 3 + [1e3] * 3, [1.0] * 3 + [1e3] * 3])
    assert judge.refusal(light, EVEN, carried(30.0)) is not None
    worst = judge.borne(EVEN, carried(30.0))[0].payload
    assert worst.share * worst.most == pytest.approx(15.0)
    assert (worst.most, worst.unit) == (10.0, "kg")
    heavy = judge.refusal(np.array([[1.1] * 6, [1.0] * 6]), EVEN, carried(30.0))
    assert heavy.startswith("right: its share of the payload is 15.")
    assert heavy.endswith("kg at start, at most 10 kg")


def test_shares_that_relieve_an_overloaded_arm_are_taken(judge, carried):
    """24 kg: both are beyond their rating, whatever W says."""
    more = np.array([[1.2] * 6, [1.0] * 6])
    assert judge.refusal(EVEN, more, carried(24.0)) is not None  # left would bear more
    assert judge.refusal(EVEN, EVEN, carried(24.0)) is None
    assert judge.refusal(EVEN, more, carried(10.4)) is None


def test_weights_along_the_axes_of_a_turned_mrf_are_judged_along_them(judge, carried):
    """Forces along z are dear for the left arm: an MRF on its side has its z level."""
    dear = np.array([[1.0, 1.0, 1e3, 1.0, 1.0, 1.0], [1.0] * 6])
    turned = Pose.from_xyz_rpy((0.0, 0.0, 0.0), (0.0, np.pi / 2.0, 0.0))
    level = judge.borne(dear, carried(5.0))[1].payload.share
    aside = judge.borne(dear, carried(5.0, turned))[1].payload.share
    assert level > 1.2 * aside
    assert aside == pytest.approx(0.25, abs=0.01)
