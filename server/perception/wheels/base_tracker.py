"""Base tracker: odometry of a base on wheels, corrected by news of where it is.

News names the telemetry tick in which it was measured, and is held against where the odometry had
the base then. What they differ by is made up for slowly; more than wheels drift by is a slip, and
then nobody knows where the tool is in World until both agree again.
"""

import math
from collections import deque
from typing import Final, Self

import numpy as np

from ....config.load import Cell
from ....config.schema.mechanism.base import DifferentialBaseSection
from ...control.frame_tree import Body
from ...control.spatial import Array, Pose, rotation_exp
from ...control.state import Memory
from ...control.wheels.odometry import Odometry
from ...control.wheels.rolling import Rolling
from ...runtime.events import Events

REMEMBERED_S: Final = 2.0
"""News that is older is of no use [s]."""
HEADING_GAIN: Final = 0.3
"""Part of a heading's difference that one piece of news corrects [1]."""
AGREES: Final = 0.5
"""Wheels grip again when odometry and news differ by less than this part of a slip [1]."""


class BaseTracker:
    """Tracks one base that rolls."""

    def __init__(
        self,
        section: DifferentialBaseSection,
        rolling: Rolling,
        T_world_base: Pose,
        period_s: float,
        events: Events,
    ) -> None:
        self._section, self._rolling, self._period_s = section, rolling, period_s
        self._events = events
        self._begun = False
        self.odometry = Odometry.at(T_world_base, np.zeros(2))
        self.twist = np.zeros(6)
        """At which the commanded base is being corrected, at its origin in World axes."""
        self.slips = False
        """Odometry and news disagree: where the tool is in World is not known."""
        self._past = deque[tuple[int, Pose]](maxlen=round(REMEMBERED_S / period_s))
        self._newest = -1

    @classmethod
    def from_cell(cls, cell: Cell, events: Events) -> Self | None:
        """Return the tracker of a loaded cell; None where nothing rolls."""
        c, rolling = cell.config, Rolling.from_cell(cell)
        if c.mechanism.base is None or rolling is None:
            return None
        place = c.mechanism.T_world_base
        T = Pose.from_xyz_rpy(place.xyz, place.rpy)
        return cls(c.mechanism.base, rolling, T, c.timing.period_s, events)

    def step(self, tick: int, memory: Memory | None, q: Array) -> Body:
        """Return the base for the command of `tick`; joints are measured at q (n,) [rad]."""
        wheels, commanded = q[:2], None if memory is None else memory.motion.q[:2]
        if commanded is None or not self._begun:
            self.odometry = self.odometry.forget(wheels, wheels)
            self._begun = True
        self.odometry = self.odometry.rolled(self._rolling, commanded, wheels)
        self.odometry, self.twist = self.odometry.corrected(
            self._section.correction, self._period_s
        )
        self._past.append((tick, self.odometry.measured))
        return self.odometry.body(self.twist)

    def take_pose(self, tick: int, T_world_base: Pose) -> None:
        """Take in where Base was at a tick."""
        T_then = self._at(tick)
        if T_then is not None:
            self._see(T_then, T_world_base)

    def take_heading(self, tick: int, yaw: float) -> None:
        """Take in which way Base pointed at a tick, in World [rad]."""
        T_then = self._at(tick)
        if T_then is None:
            return
        x, y = T_then.R[0, 0], T_then.R[1, 0]
        off = math.remainder(yaw - math.atan2(y, x), 2.0 * math.pi)
        turn = rotation_exp(np.array([0.0, 0.0, HEADING_GAIN * off]))
        self._see(T_then, Pose(turn @ T_then.R, T_then.p), heading=off)

    def _at(self, tick: int) -> Pose | None:
        """Return where the odometry had Base at a tick; None for news that is not newer."""
        if tick <= self._newest:
            return None
        found = next((T for then, T in self._past if then == tick), None)
        if found is not None:
            self._newest = tick
        return found

    def _see(self, T_then: Pose, T_world_base: Pose, heading: float | None = None) -> None:
        self.odometry = self.odometry.seen(T_then, T_world_base)
        drift = self.odometry.drift
        off = float(np.linalg.norm(drift[:3]))
        turned = float(np.linalg.norm(drift[3:])) if heading is None else abs(heading)
        far, wide = self._section.slip
        worst = max(off / far, turned / wide)
        if worst > 1.0 and not self.slips:
            self.slips = True
            self._events.warning(
                "wheels_slip",
                f"odometry and news of Base differ by {off:.3f} m and {turned:.3f} rad, at most "
                f"{far:g} m and {wide:g} rad: the tool is not held in World until they agree",
                distance_m=off,
                angle_rad=turned,
            )
        elif worst < AGREES and self.slips:
            self.slips = False
            self._events.info("wheels_grip", "odometry and news of Base agree again")
