"""Moments of shipped cells that show what they are for, and the runs that lead there."""

import json
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

from laboratory.campaign.fuzz.blind import Blind
from telerobot.config.load import Cell
from telerobot.drivers.device import DeviceError
from telerobot.protocols.messages.perception import (
    CameraPicture,
    ContourNews,
    ObstacleNews,
    ScanPoints,
)
from telerobot.server.perception.scanning.scanning import Looked
from telerobot.tools.operator.web.streams import (
    told_contour,
    told_obstacle,
    told_picture,
    told_scan,
    told_truth,
)
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.simulation import Simulation

TRAIL_S: Final = 6.0
"""So much of the run before the moment is shown as the tool's trail [s]."""
SCANS: Final = 110
"""So many scans before the moment are shown: a sweep [1]."""
LARGEST_JPEG: Final = 30_000
"""A camera's picture is smaller than this [B]."""


class Moment(NamedTuple):
    """When a cell's picture is taken, and from where."""

    time_s: float = 0.0
    """Since the run's begin; 0: the arms at rest, nothing is simulated [s]."""
    script: str | None = None
    """The cell's own where none is named."""
    view: str = "home"
    theme: str = "dark"
    handle: str | None = None
    """What the handle does that is shown at the tool: `translate` or `rotate`."""


MOMENTS: Final[Mapping[str, Moment]] = {
    "pa10": Moment(20.0),
    "pa10_all": Moment(8.5),
    "pa10_hand": Moment(2.0, handle="translate"),
    "pa10_hand_pole": Moment(7.0),
    "pa10_hand_torque": Moment(2.0),
    "pa10_nodes": Moment(10.0),
    "pa10_pair": Moment(9.0),
    "pa10_peg": Moment(9.0),
    "pa10_platform": Moment(9.0, script="platform"),
    "pa10_reflect": Moment(6.0),
    "pa10_scene": Moment(7.0),
    "pa10_trio": Moment(6.0),
    "pa10_two": Moment(6.0),
    "pa10_vision": Moment(7.0),
    "ranger": Moment(7.0),
    "rover": Moment(8.0),
    "rover_bridge": Moment(9.0),
    "snake": Moment(7.0),
    "snake30": Moment(3.0),
    "snake_shifted": Moment(4.0),
    "snake_space": Moment(7.0),
    "snake_tail": Moment(20.0),
    "snake_tail_space": Moment(20.0),
    "ur5e": Moment(7.0),
    "ur5e_scene": Moment(3.0),
}
"""Of cells whose script shows more than the cell at rest does."""


class Run(NamedTuple):
    """What a picture is made of, as a page is told it."""

    states: list[Any]
    news: list[Any]
    """What sensors and the rig told last, after the states."""

    def json(self) -> bytes:
        """Return it as JSON."""
        return json.dumps(self._asdict()).encode()


def run_of(cell: Cell, moment: Moment) -> Run:
    """Return the states of a run up to a moment, and what else was told by then."""
    if moment.time_s <= 0.0:
        return Run([], [])
    script = load_script(moment.script or cell.default_script)
    simulation = Simulation(cell, script, cameras=Blind)
    scanned = _Scanned(simulation)
    simulation.run(until=lambda: simulation.clock.time_s >= moment.time_s)
    since = simulation.clock.time_s - TRAIL_S
    states = [state for state in simulation.states if state.time_s >= since]
    told = [*_truth_and_pictures(simulation), *scanned.told()]
    return Run(
        [json.loads(state.model_dump_json()) for state in states[::2] + states[-1:]],
        [json.loads(each) for each in told],
    )


def _truth_and_pictures(simulation: Simulation) -> Iterator[str]:
    if not simulation.truths:
        return
    truth = simulation.truths[-1]
    yield told_truth(truth).text
    cell = simulation.cell
    eyes = [camera for camera in cell.cameras if camera.device is None]
    if not eyes:
        return
    try:
        from telerobot.drivers.rig.physics.camera import RigCameras
        from telerobot.drivers.vision.opencv import small_jpeg

        cameras = RigCameras(cell)
    except DeviceError:
        return  # nothing here renders pictures: the scene alone is shown
    for eye in eyes:
        base = truth.frames.get("base")
        picture = cameras.picture(eye.name, truth.q, truth.covered, truth.tags, base)
        jpeg = small_jpeg(picture, LARGEST_JPEG)
        if jpeg is not None:
            yield told_picture(CameraPicture(camera=eye.name, tick=0, jpeg=jpeg)).text
    cameras.close()


class _Scanned:
    """Keeps what a simulated scanner has told last."""

    def __init__(self, simulation: Simulation) -> None:
        self._scans: deque[bytes] = deque(maxlen=SCANS)
        self._obstacles: list[ObstacleNews] = []
        self._contour: ContourNews | None = None
        if simulation.scans is not None:
            simulation.scans.on_look = self._look

    def _look(self, looked: Looked) -> None:
        self._scans.append(looked.points_mm)
        for news in looked.messages:
            if isinstance(news, ContourNews):
                self._contour = news
            else:
                self._obstacles.append(news)

    def told(self) -> Iterator[str]:
        """Yield what a page would have been told."""
        for points in self._scans:
            yield told_scan(ScanPoints(tick=0, points_mm=points)).text
        for news in self._obstacles:
            yield told_obstacle(news).text
        if self._contour is not None:
            yield told_contour(self._contour).text
