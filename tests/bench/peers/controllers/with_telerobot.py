"""telerobot's own control computation: the tick of the daemon, with every limit on."""

import numpy as np
from telerobot.config.load import Cell, altered
from telerobot.protocols.messages.perception import ObstacleNews
from telerobot.server.control.inputs import Inputs, Intent, PathGoal
from telerobot.server.control.spatial import Array, Pose
from telerobot.server.control.tick import Control
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap
from telerobot.tools.bench.tick import settings_of

from ..scenes import PeerScene, Thing
from .contract import CLEARANCE, SELF_CLEARANCE, NoCommand

MARGIN = 1e-3
"""How much further out barriers stand: a kinematic plant gives way by nothing [m]."""
FIELD = 1.0
"""Gain of the self-motion down the potential field [1/s]."""


class Telerobot:
    """The daemon's world model and tick, without drives and bus."""

    def __init__(self, cell: Cell, scene: PeerScene) -> None:
        cell = altered(
            cell,
            {
                "avoidance.enabled": True,
                "avoidance.clearance": CLEARANCE,
                "avoidance.self_clearance": SELF_CLEARANCE,
                "avoidance.margin": MARGIN,
                "avoidance.standing": "step_aside",
                "obstacles": (),
                "redundancy.field": FIELD,
            },
        )
        self._period_s = cell.config.timing.period_s
        self._control = Control.of(cell)
        self._memory = self._control.seed(np.array(scene.start))
        self._world = ObstacleMap.from_cell(cell, Events())
        self._moving = tuple(thing for thing in scene.things if thing.moves)
        for thing in scene.things:
            self._world.take(_news(thing, 0, self._period_s), 0)
        self._settings = settings_of(cell)
        self._goal: PathGoal | None = None

    def aim(self, target: Pose) -> None:
        """Go to a target, from where the arm is."""
        serial = 0 if self._goal is None else self._goal.serial + 1
        self._goal = PathGoal(target, serial)

    def step(self, q: Array, tick: int, reference: Pose) -> Array:
        """Return the next command; the path is the position source's own."""
        for thing in self._moving:
            self._world.take(_news(thing, tick, self._period_s), tick)
        inputs = Inputs(
            time_s=tick * self._period_s,
            intent=Intent.MOVE,
            q_measured=q,
            settings=self._settings,
            goal=self._goal,
            scene=self._world.scene(tick) if self._world.known else None,
        )
        memory, (output,) = self._control.tick(self._memory, (inputs,))
        if output.refusal is not None:
            raise NoCommand(output.refusal)
        self._memory = memory
        return output.q

    @staticmethod
    def settings() -> dict[str, object]:
        """Return how it is set up."""
        return {
            "cell": "as shipped",
            "clearance_m": CLEARANCE,
            "margin_m": MARGIN,
            "barriers": "on",
            "standing": "step_aside",
            "field": FIELD,
        }


def _news(thing: Thing, tick: int, period_s: float) -> ObstacleNews:
    """Return what a sensor tells of a thing that it sees in a tick."""
    way = thing.at(tick * period_s)
    along = thing.axis * thing.half_length
    told: dict[str, object] = {"name": thing.name, "tick": tick, "shape": thing.shape}
    match thing.shape:
        case "box":
            told |= {"xyz": tuple(way.centre), "rpy": thing.rpy, "half_size": thing.half_size}
        case "sphere":
            told |= {"xyz": tuple(way.centre), "radius": thing.radius}
        case "capsule":
            told |= {"xyz": tuple(way.centre - along), "to": tuple(way.centre + along)}
            told |= {"radius": thing.radius}
    if thing.moves:
        told |= {"velocity": tuple(way.velocity), "max_speed": thing.max_speed}
        told |= {"max_acceleration": thing.max_acceleration}
    return ObstacleNews.model_validate(told)
