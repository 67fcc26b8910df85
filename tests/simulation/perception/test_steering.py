"""A rover that is driven straight at things steers aside, in the whole closed loop."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Result, Simulation


def driven(
    steer: float, seconds: float, rates: tuple[float, float] = (0.3, 0.0), **bridge: float
) -> tuple[Simulation, Result]:
    """A rover that is driven at a bridge, too high to be met but for its pillars."""
    cell = altered(load_cell("rover_aside"), {"contour.steer": steer, "rig.bridge.distance": 2.2})
    cell = altered(cell, {"height": 2.0, **bridge}, "rig.bridge")
    step = {"at_s": 0.3, "cmd/drive": {"rates": rates}}
    run = Simulation(cell, Script.model_validate({"duration_s": seconds, "step": [step]}))
    return run, run.run()


def names(run: Simulation) -> list[str]:
    return [event.name for event in run.events]


@pytest.mark.parametrize(
    ("bridge", "least", "most"),
    [
        ({"offset": 0.5}, 0.15, 0.5),
        ({"offset": -0.5}, -0.5, -0.15),
        ({"offset": 0.55, "skew": 0.4}, 0.2, 0.8),
        ({"width": 0.5, "offset": 0.0}, -2.0, -0.6),  # there is no way between: around both
    ],
)
def test_the_base_steers_around_a_pillar_and_is_on_its_heading_again(
    bridge: dict[str, float], least: float, most: float
) -> None:
    run, result = driven(0.8, 16.0, **bridge)
    x, y, *_, yaw = result.truths[-1].frames["base"]
    assert x > 3.0
    assert least < y < most
    assert abs(yaw) < 0.1
    s = result.summary
    assert (s["failure"], s["limit_violations"], s["mode"]) == (None, 0, "enabled")
    assert s["min_clearance_m"] > 0.05
    assert s["contact_peak_n"] == 0.0
    assert names(run).count("steers_aside") <= 2  # aside, and back
    assert "steers_aside" in names(run)
    assert "passage_refused" not in names(run)


def test_without_the_key_it_stops_before_the_pillar_and_says_why() -> None:
    run, result = driven(0.0, 16.0, offset=0.5)
    x, y, *_ = result.truths[-1].frames["base"]
    assert x < 1.5
    assert abs(y) < 1e-3
    (refused,) = [event for event in run.events if event.name == "passage_refused"]
    assert refused.values["reason"] == "base_blocked"
    assert result.summary["min_clearance_m"] > 0.3


def test_who_turns_the_base_himself_is_obeyed_and_stopped_before_the_pillar() -> None:
    run, result = driven(0.8, 16.0, (0.2, -0.03), offset=0.5)
    x, y, *_, yaw = result.truths[-1].frames["base"]
    assert "steers_aside" not in names(run)
    assert x < 1.5
    assert y < 0.0
    assert yaw == pytest.approx(-0.15 * x / 1.0, abs=0.05)
    assert np.abs(result.truths[-1].dq[:2]).max() < 0.01
    s = result.summary
    assert (s["failure"], s["limit_violations"], s["contact_peak_n"]) == (None, 0, 0.0)
