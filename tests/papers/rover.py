"""A rover without dynamics: base and arm are where they are put, and every ray is cast.

What is tested here is what the scanner makes of it; the whole loop is `tests/simulation`.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.rig import BoxSection, RigBridgeSection, RigPersonSection
from telerobot.drivers.rig.physics.scene import build_model
from telerobot.drivers.rig.physics.sensors import Rangefinder
from telerobot.server.control.spatial import Pose
from telerobot.server.perception.scanning.placing import MeasuredInstant
from telerobot.server.perception.scanning.scanning import Looked, Scanning

Array = NDArray[np.float64]
PERIOD_S = 0.01
RADIUS = 0.12
"""Of its wheels [m]."""
FOOT = (0.2, 0.5)
"""Of the arm: ahead of the base's middle, above the floor [m]."""


class Rover:
    """Drives ahead as it may, folds as it should."""

    def __init__(
        self,
        bridge: RigBridgeSection | None,
        speed: float = 0.0,
        seed: int = 1,
        start: tuple[float, ...] | None = None,
        sweep: tuple[float, float] | None = None,
        boxes: tuple[BoxSection, ...] = (),
        person: RigPersonSection | None = None,
        **contour: object,
    ) -> None:
        """Put it before a bridge, its arm in the posture `start`, sweeping between two angles.

        `boxes` stand around it, and a `person`, who can be placed.
        """
        cell = load_cell("rover_bridge")
        config = cell.config
        rig = {"bridge": bridge, "seed": seed, "boxes": boxes, "person": person}
        self.cell = altered(altered(cell, rig, "rig"), contour, "contour")
        self.model, fixed = build_model(self.cell)
        self.data = mujoco.MjData(self.model)
        self.finder = Rangefinder(self.cell, self.model, self.data)
        self.scanning = Scanning(self.cell)
        axis = config.mechanism.sweep
        if axis is None:
            raise ValueError("the cell's scanner does not sweep")
        self.sweep = axis
        if sweep is not None:
            self.sweep = self.sweep.model_copy(
                update=dict(zip(("low", "high"), sweep, strict=True))
            )
        self.q = np.array(config.mechanism.postures["start"])
        if start is not None:
            self.q[2:-1] = start
        self.q[-1] = self.sweep.low
        self.x, self.speed, self.time_s, self.tick = 0.0, speed, 0.0, 0
        self.rolled = 0.0
        """How far its wheels, and so its odometry, say that it came [m]."""
        self.grip = 1.0
        """Share of that which it really comes [1]."""
        self.newest: Looked | None = None
        self.phases: list[str] = []
        self.least = 1.0
        names = [self.model.geom(g).name for g in range(self.model.ngeom)]
        self.bridge = [g for g, name in enumerate(names) if name.startswith("bridge_")]
        own = self.model.body("chassis").id
        self.arm = [
            g for g in range(self.model.ngeom)
            if self.model.body_rootid[self.model.geom_bodyid[g]] == own and g not in fixed
        ]  # fmt: skip
        self.put()

    def put(self) -> None:
        """Put base and joints into the physics."""
        self.data.qpos[:7] = self.x, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
        self.data.qpos[7:] = self.q
        mujoco.mj_kinematics(self.model, self.data)

    def run(self, seconds: float) -> "Rover":
        """Let time pass."""
        for _ in range(round(seconds / PERIOD_S)):
            self.step()
        return self

    def step(self) -> None:
        """One control period; the rays of every two milliseconds are cast together."""
        before, x, slope = self.q.copy(), self.x, self._sweep()
        rolled = self.rolled
        step = np.zeros(len(self.q))
        step[-1] = slope * PERIOD_S
        answer = None if self.newest is None else self.newest.answer
        most = self.speed if answer is None else min(self.speed, answer.most_speed)
        if answer is not None and answer.posture is not None:
            way = answer.posture - self.q[2:-1]
            step[2:-1] = way * min(1.0, 0.7 * PERIOD_S / max(float(np.abs(way).max()), 1e-9))
        for part in (0.2, 0.4, 0.6, 0.8, 1.0):
            self.q, self.rolled = before + part * step, rolled + part * most * PERIOD_S
            self.x = x + part * most * PERIOD_S * self.grip
            self.q[:2] = self.rolled / RADIUS
            self.put()
            time_s = self.time_s + part * PERIOD_S
            scan = self.finder.step(time_s)
            if scan is not None:
                self.scanning.take(scan, scan.start_us * 1e-6)
        self.time_s, self.tick = self.time_s + PERIOD_S, self.tick + 1
        base = Pose(np.eye(3), np.array([self.rolled, 0.0, 0.0]))
        instant = MeasuredInstant(self.tick, self.time_s, self.q.copy(), base)
        for looked in self.scanning.hear([instant]):
            if looked.answer is not None:
                self.newest = looked
                if not self.phases or self.phases[-1] != looked.answer.phase:
                    self.phases.append(looked.answer.phase.value)
        if self.tick % 10 == 0 and self.bridge:
            self.least = min(self.least, self.clearance())

    def place_person(self, x: float, y: float) -> None:
        """Put the person somewhere on the floor."""
        body = self.model.body_mocapid[self.model.body("person").id]
        self.data.mocap_pos[body, :2] = x, y

    def _sweep(self) -> float:
        """Return the rate of the axis that sweeps [rad/s]."""
        sweep = self.sweep
        rate = 2.0 * (sweep.high - sweep.low) / sweep.period_s
        return rate if (self.time_s % sweep.period_s) < 0.5 * sweep.period_s else -rate

    def clearance(self) -> float:
        """Return the true distance of arm and base from the bridge, at most 1 [m]."""
        return min(
            float(mujoco.mj_geomDistance(self.model, self.data, a, b, 1.0, None))
            for a in self.arm
            for b in self.bridge
        )


def filled(bridge: RigBridgeSection) -> Array:
    """Return the share of each of 20 times 40 cells that a straight bridge fills."""
    y, z = np.meshgrid((np.arange(400) + 0.5) * 0.005 - 1.0, (np.arange(200) + 0.5) * 0.005)
    half, under = 0.5 * bridge.width, bridge.height - FOOT[1]
    outer = np.abs(y) < half + bridge.side
    pillar = (np.abs(y) > half) & outer & (z < under + bridge.side)
    beam = (z > under) & (z < under + bridge.side) & outer
    found: Array = (pillar | beam).reshape(20, 10, 40, 10).mean(axis=(1, 3))
    return found


def found_and_false(rover: Rover, bridge: RigBridgeSection) -> tuple[float, int]:
    """Return the share of filled cells that were found, and how many were found where none is."""
    if rover.newest is None or rover.newest.contour is None:
        raise ValueError("nothing was seen yet")
    occupied, share = ~np.isnan(rover.newest.contour.nearest), filled(bridge)
    full = share > 0.999
    seen, false = np.count_nonzero(occupied & full), np.count_nonzero(occupied & (share == 0))
    return float(seen / full.sum()), int(false)
