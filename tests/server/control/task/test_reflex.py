"""The tool's part of folding: the twist of an arm that folds, by the gain's share."""

import numpy as np
import pytest
from telerobot.config.schema.sources import ReflexSection
from telerobot.server.control.task.sources import Reflex

from .shown import SHAPING, shown

FOLDING = np.array([0.1, -0.2, -0.05, 0.0, 0.3, 0.0])


@pytest.mark.parametrize(
    "gain", [np.ones(6), np.array([1.0, 0.0, 0.5, 0.0, 0.0, 1.0]), np.zeros(6)]
)
def test_it_asks_for_the_gains_share_of_the_twist_of_folding(gain: np.ndarray) -> None:
    source = Reflex(ReflexSection(), SHAPING)
    twist, _ = source.rate(shown(folding=FOLDING), source.idle(), gain)
    np.testing.assert_array_equal(twist, gain * FOLDING)


def test_it_asks_for_nothing_where_nothing_folds_or_the_joints_are_led() -> None:
    source = Reflex(ReflexSection(), SHAPING)
    for context in (shown(), shown(folding=FOLDING, jog=np.zeros(7))):
        twist, _ = source.rate(context, source.idle(), np.ones(6))
        assert not twist.any()
