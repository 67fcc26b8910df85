"""`telerobot identify` of one of two arms: it moves that arm and reads that arm's sensor."""

import numpy as np
import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.server.identification.payload import attitudes, judge
from telerobot.tools.identify.cli import identify, snippet, subject_of


@pytest.fixture
def cell():
    return load_cell("pa10_two")


def test_the_sensor_of_the_named_arm_is_identified(cell):
    subject = subject_of(cell, "right")
    stops = attitudes(subject.part, "ready", 6, 0.15)
    samples = identify(cell, stops, subject=subject, simulate=True)
    measured = [stop.q for stop in stops if stop.measure]
    np.testing.assert_allclose([s.q for s in samples], measured, atol=2e-3)
    found = judge(subject.part, samples)
    told = subject.part.config.mechanism.force_torque
    assert found.mass == pytest.approx(told.payload.mass, abs=2e-3)
    np.testing.assert_allclose(found.bias, told.bias, atol=0.02)
    assert snippet(subject.part, found).startswith("[mechanisms.force_torque]\n")


def test_which_arm_has_to_be_said_where_there_are_several(cell):
    with pytest.raises(ConfigError, match="say which: --mechanism, one of left, right"):
        subject_of(cell, None)
    with pytest.raises(ConfigError, match="'rihgt': no such mechanism; did you mean 'right'"):
        subject_of(cell, "rihgt")
    alone = load_cell("pa10")
    assert subject_of(alone, None).part is alone
    assert subject_of(alone, "arm").joints == slice(0, 7)
