"""What is told of a contour's boxes."""

from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.protocols.messages.perception import ObstacleNews
from telerobot.protocols.sick import Scan
from telerobot.server.control.spatial import Pose
from telerobot.server.perception.scanning.contour import CellBox, along_arc
from telerobot.server.perception.scanning.scanning import Scanning


def test_boxes_go_in_the_order_in_which_they_came_whatever_the_hash_seed():
    scanning, T = Scanning(load_cell("rover_bridge")), Pose.identity()
    boxes = tuple(CellBox((0, 1), (k, k + 1), 1.0, 1.1) for k in range(20))
    came = [news.name for news in scanning._boxes(1, boxes, T)]
    gone = list(scanning._boxes(2, (), T))
    assert gone == [ObstacleNews(name=name, tick=2, remove=True) for name in came]


@pytest.mark.parametrize("curvature", [-0.8, 0.8])
def test_on_an_arc_things_reach_further_from_the_outer_side_as_the_nose_sweeps_there(
    curvature: float,
) -> None:
    scanning = Scanning(load_cell("rover_aside"))
    foot, nose, arm = np.array([0.2, 0.0, 0.5]), 0.35, 0.9
    y, z = np.meshgrid(np.linspace(-0.1, 0.1, 30), np.linspace(-0.4, 0.6, 60))
    seen = np.stack([np.full(y.size, 1.0), y.ravel(), z.ravel()], axis=1)
    hits = np.full(len(seen), 5.0)
    met = scanning._met(seen, hits, -0.5, curvature, arm)
    along = along_arc(seen, foot, curvature)
    for obstacles, front in ((met.high[:, 1] > 0.05, arm), (met.high[:, 1] < -0.05, nose)):
        low, high = met.low[obstacles, 0].min(), met.high[obstacles, 0].max()
        further = 0.5 * curvature * front**2
        # To a cell, which a thing may fill in part.
        assert low == pytest.approx(along[:, 1].min() + min(0.0, further), abs=0.051)
        assert high == pytest.approx(along[:, 1].max() + max(0.0, further), abs=0.051)


def test_who_is_late_looks_at_every_scan_but_makes_a_contour_of_the_newest_alone() -> None:
    cell = load_cell("rover_bridge")
    scanner, joints = cell.config.scanner, len(cell.robot.joints)
    scanning = Scanning(cell)
    angle = scanner.first + scanner.step * np.arange(scanner.rays)
    wall = np.abs(1.5 / np.sin(np.clip(angle, 0.5, np.pi - 0.5)))

    def states(first: int, last: int) -> list[SimpleNamespace]:
        each = [SimpleNamespace(tick=k, time_s=0.01 * k, frames={}) for k in range(first, last)]
        return [SimpleNamespace(q=(0.0,) * joints, **vars(state)) for state in each]

    def scan(k: int) -> None:
        at_us = 20_000 * k
        scanning.take(
            Scan(k, at_us, at_us, scanner.rate_hz, scanner.first, scanner.step, wall), 0.02 * k
        )

    for k in range(1, 5):  # in time: every second scan has a contour
        scan(k)
        looked = list(scanning.listen(states(2 * k - 1, 2 * k + 3), 0.02 * k))
        assert [each.contour is not None for each in looked] == [k % 2 == 0]
    for k in range(5, 12):
        scan(k)
    before = scanning.memory.hits.sum()
    looked = list(scanning.listen(states(11, 26), 0.25))
    assert [each.contour is not None for each in looked] == [False] * 6 + [True]
    assert looked[-1].messages[0].tick == looked[-1].tick == 24
    assert scanning.memory.hits.sum() > 2.5 * before  # four scans, and seven more
    assert scanning.contours == 3
