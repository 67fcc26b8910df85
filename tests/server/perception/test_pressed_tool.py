"""Contact of a tool while its joints are commanded: beyond the threshold, and more than before."""

from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.server.control.spatial import Pose
from telerobot.server.mode import Mode
from telerobot.server.perception.contact import LASTS, RELIEVED_S, STAYS_S, PressedTool

T, THRESHOLD = 0.01, 30.0
NOTHING, RELIEF = np.zeros(6), np.array([0.0, 0.0, 0.05, 0.0, 0.0, 0.0])


def output(force, relief=NOTHING):
    wrench = None if force is None else np.array([0.0, 0.0, force, 0.0, 0.0, 0.0])
    here = Pose.identity()
    return SimpleNamespace(
        wrench=wrench,
        twists={"force": relief},
        T_world_mrf=here,
        T_world_mrf_measured=here,
    )


@pytest.fixture
def pressed():
    return PressedTool(THRESHOLD, T)


def after(pressed, forces, relief=NOTHING, by_joint=True, mode=Mode.ENABLED):
    """Return in which tick of these it is a reason to stop; None for never."""
    for k, force in enumerate(forces):
        pressed.follow(output(force, relief), by_joint, mode)
        if pressed.touched:
            return k
    return None


def test_contact_beyond_the_threshold_counts_once_it_lasts(pressed):
    assert after(pressed, [0.0] * 5 + [29.0] * 20) is None
    pressed.follow(output(0.0), False, Mode.ENABLED)
    after(pressed, [0.0] * 5)
    assert after(pressed, [31.0] * 50) == LASTS - 1


def test_a_single_sample_is_no_contact(pressed):
    assert after(pressed, ([0.0] * 48 + [500.0] * 2) * 5) is None


@pytest.mark.parametrize("forces", [[15.0], [25.0, 25.0, 25.0, 0.0]], ids=["steady", "rings"])
def test_lighter_contact_counts_once_it_stays(pressed, forces):
    stops = after(pressed, [0.0] * 5 + forces * 400)
    assert 0.95 * STAYS_S < T * (stops - 5) < 1.4 * STAYS_S


def test_a_light_touch_in_passing_is_none(pressed):
    assert after(pressed, [0.0] * 5 + ([25.0] * 25 + [0.0] * 75) * 5) is None


def test_force_control_may_relieve_it_first_but_not_for_long(pressed):
    after(pressed, [0.0] * 5)
    waited = after(pressed, [100.0] * 50, RELIEF)
    assert T * (waited - LASTS) == pytest.approx(RELIEVED_S, abs=2 * T)
    pressed.follow(output(0.0), False, Mode.ENABLED)
    after(pressed, [0.0] * 5)
    assert after(pressed, [100.0] * 6 + [20.0] * 5, RELIEF) == 6


def test_contact_that_was_there_counts_by_how_much_it_grows(pressed):
    assert after(pressed, [60.0] * 50) is None
    assert after(pressed, [60.0 - k for k in range(50)]) is None
    assert after(pressed, [31.0] * 50) is not None


def test_where_the_sources_lead_the_arm_it_is_none(pressed):
    assert after(pressed, [100.0] * 50, by_joint=False) is None
    assert not pressed.watching


def test_it_is_watched_on_after_the_stop_and_forgotten_with_the_sensor(pressed):
    after(pressed, [0.0] * 5 + [100.0] * 50)
    pressed.follow(output(100.0), False, Mode.HOLD)
    assert pressed.watching
    assert not pressed.touched
    pressed.follow(output(None), False, Mode.HOLD)
    assert not pressed.watching
