"""What is told of a contour's boxes."""

from telerobot.config.load import load_cell
from telerobot.protocols.messages.perception import ObstacleNews
from telerobot.server.control.spatial import Pose
from telerobot.server.perception.scanning.contour import CellBox
from telerobot.server.perception.scanning.scanning import Scanning


def test_boxes_go_in_the_order_in_which_they_came_whatever_the_hash_seed():
    scanning, T = Scanning(load_cell("rover_bridge")), Pose.identity()
    boxes = tuple(CellBox((0, 1), (k, k + 1), 1.0, 1.1) for k in range(20))
    came = [news.name for news in scanning._boxes(1, boxes, T)]
    gone = list(scanning._boxes(2, (), T))
    assert gone == [ObstacleNews(name=name, tick=2, remove=True) for name in came]
