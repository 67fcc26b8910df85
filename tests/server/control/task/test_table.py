"""What holds for every source in the table."""

import numpy as np
import pytest
from telerobot.config.schema.sources import SOURCES, SourcesSection
from telerobot.server.control.inputs import Intent, PathGoal, StickCommand, ViewGoal
from telerobot.server.control.spatial import Pose
from telerobot.server.control.task.task import KINDS

from .shown import SHAPING, granted, shown

ALL = np.ones(6)
FAR = Pose(np.eye(3), np.array([0.3, -0.2, 0.1]))


@pytest.fixture(params=SOURCES)
def source(request):
    return KINDS[request.param](getattr(SourcesSection(), request.param), SHAPING)


def busy(**said):
    """Return a context in which every source has something to do."""
    contact = np.array([20.0, -10.0, 5.0, 0.3, 0.2, 0.1])
    given = {
        "stick": StickCommand(0.1 * ALL, np.eye(3)),
        "goal": PathGoal(FAR, 1),
        "view": ViewGoal(Pose.identity(), FAR),
        "wrench": contact,
        "hand": contact,
    }
    return shown(**{**given, **said})


def test_every_section_has_its_source_in_the_order_of_the_sum():
    assert tuple(KINDS) == SOURCES


def test_it_begins_idle_and_asks_for_nothing_where_there_is_nothing(source):
    twist, _ = source.rate(shown(), source.idle(), 0.5 * ALL)
    assert twist.shape == (6,)
    assert not twist.any()


@pytest.mark.parametrize("phase", [{"intent": Intent.SEED}])
def test_it_asks_for_nothing_while_the_arm_may_not_move(source, phase):
    _, state = source.rate(busy(), source.idle(), 0.5 * ALL)
    twist, _ = source.rate(busy(**phase), state, 0.5 * ALL)
    assert not twist.any()


def test_a_gain_of_zero_asks_for_nothing(source):
    state = source.idle()
    for _ in range(20):
        twist, state = source.rate(busy(), state, np.zeros(6))
        state = source.advance(state, granted(twist=twist))
        assert not twist.any()


def test_a_tick_changes_no_state_so_that_it_can_be_computed_again(source):
    state = source.idle()
    for _ in range(20):
        first, after = source.rate(busy(), state, 0.5 * ALL)
        let = granted(share=0.7, twist=first)
        then, _ = source.rate(busy(), source.advance(after, let), 0.5 * ALL)
        again, after_again = source.rate(busy(), state, 0.5 * ALL)
        then_again, _ = source.rate(busy(), source.advance(after_again, let), 0.5 * ALL)
        np.testing.assert_array_equal(first, again)
        np.testing.assert_array_equal(then, then_again)
        state = source.advance(after, let)
