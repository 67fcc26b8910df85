"""A rover on four wheels that skid as it turns, by the physics' truth."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.tools.simulation.simulation import simulate

ROLLS = {"slip_factor": 1.0, "centre": 0.0}
"""What wheels are taken for that do not skid."""


def turned(
    play, v: float, w: float, *, gyroscope: bool = False, **wheels: float
) -> tuple[float, float, float]:
    """Drive for two seconds; return the true turn [rad], and what odometry is off [m], [rad]."""
    keys: dict[str, object] = {} if gyroscope else {"mechanism.imu": None}
    keys |= {f"mechanism.base.wheels.{key}": value for key, value in wheels.items()}
    run = play(
        {"at_s": 0.2, "cmd/drive": {"rates": [v, w]}},
        {"at_s": 2.2, "cmd/drive": {"rates": [0.0, 0.0]}},
        seconds=2.9,
        cell=altered(load_cell("rover_skid"), keys),
    )
    assert run.summary["limit_violations"] == 0
    truth = run.truths[-1].frames["base"][5]
    return truth, run.summary["odometry_error_m"], run.summary["odometry_error_rad"]


@pytest.mark.parametrize(("v", "w"), [(0.0, 0.5), (0.2, -0.4)])
def test_with_its_slip_factor_a_base_that_skids_knows_where_it_points(play, v, w):
    """Without, it turns by less than two thirds of what it is told, and nobody knows."""
    true, _, off = turned(play, v, w, **ROLLS)
    assert off > 0.5 * abs(true)
    true, far, off = turned(play, v, w)
    assert true == pytest.approx(2.0 * w, rel=0.05)
    assert off < 0.04 * abs(true)
    assert far < 0.03


def test_with_a_gyroscope_a_base_that_skids_knows_where_it_points_without_a_factor(play):
    true, _, off = turned(play, 0.2, -0.4, gyroscope=True, **ROLLS)
    assert abs(true) > 0.4
    assert off < 0.03


def test_with_its_centre_of_turning_a_base_that_skids_knows_where_it_is(play):
    """The arm's weight lies ahead, and so does the point that it turns about."""
    assert turned(play, 0.0, 0.5, centre=0.0)[1] > 0.08
    assert turned(play, 0.0, 0.5)[1] < 0.03


def test_the_tool_stands_in_world_above_a_base_that_skids():
    result = simulate("rover_skid", "hold_in_world")
    start = next(e for e in result.summary["events"] if e["name"] == "frame_set")["t_s"] + 0.3
    poses = np.array([t.pose_mrf[:3] for t in result.truths if t.time_s > start])
    assert result.summary["base_travel_m"] > 0.4
    assert np.linalg.norm(poses - poses[0], axis=1).max() < 0.03


def test_the_shipped_script_ends_where_the_base_says_that_it_is():
    result = simulate("rover_skid")
    assert result.summary["ok"], result.summary["expected"]
