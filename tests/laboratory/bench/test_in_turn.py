"""Two revisions period by period: what is told of both, and what cannot be measured."""

import pytest
from laboratory.bench.against import HERE
from laboratory.bench.in_turn import figures, measured
from telerobot.drivers.device import DeviceError


def test_a_ratio_is_of_what_a_period_takes_now_to_what_it_took():
    found = figures({"before": [100.0, 200.0, 600.0], "now": [50.0, 100.0, 150.0]})
    assert (found["before_p50_us"], found["now_p50_us"]) == (200.0, 100.0)
    assert (found["before_mean_us"], found["now_mean_us"]) == (300.0, 100.0)
    assert found["ratio_p50"] == 0.5
    assert found["ratio_mean"] == pytest.approx(1.0 / 3.0)


def test_all_periods_of_both_are_measured():
    found = measured({"before": HERE, "now": HERE}, 7)
    assert list(found) == ["before", "now"]
    assert all(len(spent) == 7 and min(spent) > 0.0 for spent in found.values())


def test_what_cannot_be_measured_says_why():
    with pytest.raises(DeviceError, match=r"now: .*no_such_cell"):
        measured({"now": HERE}, 7, "no_such_cell")
