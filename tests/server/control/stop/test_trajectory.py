import numpy as np
import pytest
from telerobot.server.control.stop.motion import Motion


@pytest.mark.parametrize("value", [1e-8, -1e-8, np.nan, np.inf])
@pytest.mark.parametrize("which", ["dq", "ddq"])
def test_a_motion_stands_only_while_every_rate_is_small(which, value):
    rest = Motion.at_rest(np.ones(3))
    moving = rest._replace(**{which: np.array([0.0, value, 0.0])})
    assert rest.stands()
    assert not moving.stands()
    assert moving.stands(2e-8) == (abs(value) < 2e-8)
    assert not moving.stands(5e-9)
