"""One controller in one scene, on a kinematic plant, judged by the true distances."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from telerobot.config.load import Cell
from telerobot.server.control.spatial import Array, Pose, pose_error

from .controllers.contract import Controller, NoCommand
from .geometry import PeerGeometry
from .reference import Reference
from .scenes import PeerScene

SUBSTEPS = 2
"""Distances are measured so often a period, joints in straight lines between ticks [1]."""
REACHED = (2e-3, 1e-2)
"""A target is reached within this distance [m] and angle [rad]."""
PATIENCE_S = 4.0
"""Allowed for a target beyond the time of its reference [s]."""
REST_S = 1.0
STILL = 1e-2
"""An arm that turned no joint by more in `REST_S` is at rest, or creeps [rad]."""
OWN = 1e-3
"""The arm closes a distance by its own motion if that brings it nearer faster than this [m/s]."""


@dataclass
class PeerResult:
    """Result of one run."""

    controller: str
    seed: int
    feasible: bool
    moving: bool
    targets: int
    reached: int = 0
    stuck: int = 0
    """Targets that were not reached, with the arm at rest or creeping in the end."""
    clearance_m: float = math.inf
    """Least true distance from things."""
    own_clearance_m: float = math.inf
    collisions: int = 0
    """Times that a distance, from things or of links, fell below zero."""
    own_collisions: int = 0
    """Those of them that the arm's own motion closed: the rest ran into it."""
    off_path_m: float = 0.0
    """Mean distance of the tool from the straight path."""
    no_command: int = 0
    """Periods without a command."""
    acceleration: float = 0.0
    """Greatest joint acceleration over the drive's bound [1]."""
    jerk: float = 0.0
    """Greatest joint jerk over the drive's bound [1]."""
    duration_s: float = 0.0
    tick_us: list[float] = field(default_factory=list)


def run(
    name: str, build: Callable[[Cell, PeerScene], Controller], cell: Cell, scene: PeerScene
) -> PeerResult:
    """Lead the arm to one target after the other and return what was seen."""
    return _Run(name, build(cell, scene), cell, scene).whole()


class _Run:
    def __init__(self, name: str, controller: Controller, cell: Cell, scene: PeerScene) -> None:
        self._controller, self._scene = controller, scene
        self._T = cell.config.timing.period_s
        position = cell.config.sources.position
        self._speed = position.speed, position.angular_speed
        drives = {drive.joint: drive for drive in cell.config.mechanism.drives}
        ordered = [drives[joint.name] for joint in cell.robot.joints]
        self._A = np.array([drive.max_acceleration for drive in ordered])
        self._J = np.array([drive.max_jerk for drive in ordered])
        self._geometry = PeerGeometry(cell, scene.things)
        self._q = [np.array(scene.start)] * 4
        self._tick = 0
        self._off: list[float] = []
        self._touching = False
        self.result = PeerResult(name, scene.seed, scene.feasible, scene.moves, len(scene.targets))

    def whole(self) -> PeerResult:
        for target in self._scene.targets:
            self._leg(target.pose)
        self.result.off_path_m = float(np.mean(self._off))
        self.result.duration_s = self._tick * self._T
        return self.result

    def _leg(self, target: Pose) -> None:
        start = self._geometry.tool(self._q[-1])
        reference = Reference.between(start, target, *self._speed)
        self._controller.aim(target)
        latest = [self._q[-1]]
        for i in range(1, round((reference.duration_s + PATIENCE_S) / self._T)):
            self._step(reference.at(i * self._T))
            tool = self._geometry.tool(self._q[-1])
            self._off.append(reference.off_path(tool.p))
            away = pose_error(target, tool)
            near = np.linalg.norm(away[:3]) < REACHED[0] and np.linalg.norm(away[3:]) < REACHED[1]
            if near and i * self._T > reference.duration_s:
                self.result.reached += 1
                return
            latest = [*latest, self._q[-1]][-round(REST_S / self._T) :]
        if np.abs(np.array(latest) - latest[-1]).max() < STILL:
            self.result.stuck += 1

    def _step(self, reference: Pose) -> None:
        q = self._q[-1]
        start = time.perf_counter()
        try:
            after = self._controller.step(q, self._tick, reference)
        except NoCommand:
            after = q
            self.result.no_command += 1
        self.result.tick_us.append(1e6 * (time.perf_counter() - start))
        for k in range(1, SUBSTEPS + 1):
            before = q + (after - q) * ((k - 1) / SUBSTEPS)
            self._judge(before, q + (after - q) * (k / SUBSTEPS), self._tick + k / SUBSTEPS)
        self._q = [*self._q[1:], after]
        self._tick += 1
        dq = np.diff(np.array(self._q), axis=0) / self._T
        ddq = np.diff(dq, axis=0) / self._T
        jerk = (ddq[1] - ddq[0]) / self._T
        self.result.acceleration = max(
            self.result.acceleration, float((np.abs(ddq[-1]) / self._A).max())
        )
        self.result.jerk = max(self.result.jerk, float((np.abs(jerk) / self._J).max()))

    def _judge(self, before: Array, q: Array, tick: float) -> None:
        self._geometry.move(tick * self._T)
        now = self._geometry.clearance(q)
        result = self.result
        result.clearance_m = min(result.clearance_m, now.things)
        result.own_clearance_m = min(result.own_clearance_m, now.own)
        touching = min(now) < 0.0
        if touching and not self._touching:
            result.collisions += 1
            way = OWN * self._T / SUBSTEPS
            result.own_collisions += min(self._geometry.clearance(before)) > min(now) + way
        self._touching = touching
