"""An arm that nobody tells to move: whether it makes way for what comes, how far, and its way back.

Obstacles' news needs no lease. So an arm that stands goes out of the way only as its cell says, no
part of it further than a reach from where it was told to stand, and comes back when it can.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from ....config.schema.obstacles import AvoidanceSection
from ..mechanism.null_space.redundancy import ObjectiveGains
from ..proximity.capsules import Capsules, Placed
from ..spatial import Array, Pose, pose_error
from ..stop.way_to_rest import Stop

BACK_GAIN: Final = 2.0
"""Way back, close to where the arm was told to stand [1/s]."""

BACK_SPEED: Final = 0.1
"""The tool comes back no faster than this [m/s]: nobody looks."""

BACK_RATE: Final = 0.3
"""And no joint faster than this part of its greatest speed [1]."""

LAST_PART: Final = 0.25
"""In the last part of its reach an arm makes way ever slower [1]."""

HOME: Final = 2e-4
"""An arm is back within this angle of every joint [rad] …"""

HOME_M: Final = 1e-3
"""… or, where a goal leads its tool back, within this distance [m]."""

MOVED: Final = 1e-4
"""Self-motion below this leads nowhere [rad/s]."""

OUTSIDE: Final = ("field", "spheres")
"""Objectives that look at obstacles: they act on an arm at a posture, too."""


class Station(NamedTuple):
    """Where an arm was told to stand that has left there to make way."""

    q: Array
    """Posture (n,) [rad]."""
    T_world_mrf: Pose
    """The MRF there."""
    ends: Array | None
    """Ends of its capsules (c, 2, 3) in World [m]; None where its shape is not known."""


class Stance(NamedTuple):
    """How an arm meets what comes, in one tick."""

    makes_way: float
    """Part of the speed of what comes that it makes way at, 0 to 1."""
    tool_stays: bool
    """It makes way by self-motion alone."""
    alert: bool
    """It stands, and may leave: its station is kept."""
    station: Station | None


COMMANDED: Final = Stance(1.0, False, False, None)
"""An arm that is told to move makes way as fast as what comes."""

STANDS: Final = Stance(0.0, True, False, None)
"""It stands, whatever comes."""


class Standing:
    """Decides how one arm that stands meets what comes."""

    def __init__(self, section: AvoidanceSection, capsules: Capsules | None, velocity: Array):
        """Build it; joints go at most at `velocity` (n,) [rad/s]."""
        self._section, self._capsules, self._velocity = section, capsules, velocity
        self._outside: tuple[ObjectiveGains, ObjectiveGains] | None = None

    def may_leave(self, moving: bool, held: bool) -> bool:
        """Return whether the cell lets an arm leave that stands in ENABLED, or is held in HOLD."""
        section = self._section
        return section.standing != "stand" and (moving or (held and section.standing_in_hold))

    def stance(self, station: Station | None, q: Array, placed: Placed | None) -> Stance:
        """Return how an arm at q (n,) [rad] meets what comes, where it may leave."""
        tool_stays = self._section.standing == "self_motion"
        if station is None:
            return Stance(1.0, tool_stays, True, None)
        left = 1.0 - self._moved(station, q, placed) / self._section.standing_reach
        return Stance(min(1.0, max(0.0, left / LAST_PART)), tool_stays, True, station)

    def begun(self, stop: Stop, T_world_mrf: Pose) -> Station:
        """Return the station of an arm that leaves: where its stop would end.

        Its tool is to stay where it is now.
        """
        q = stop.at(stop.to_go_s).q
        ends = None if self._capsules is None else self._capsules.place(q[None]).ends[0]
        return Station(q, T_world_mrf, ends)

    def back(self, station: Station, q: Array, J: Array, factor: float) -> Array:
        """Return the joint rates (n,) from q (n,) back to the station [rad/s].

        J (6, n) is the tool's, `factor` the reduced-speed setting.
        """
        error = station.q - q
        size = float(np.abs(error / self._velocity).max())
        rate = min(BACK_GAIN, factor * BACK_RATE / max(size, 1e-12))
        speed = rate * float(np.linalg.norm(J[:3] @ error))
        return np.asarray(rate * min(1.0, factor * BACK_SPEED / max(speed, 1e-12)) * error)

    def tool_back(self, station: Station, T_world_mrf: Pose) -> Array:
        """Return the twist (6,) of the MRF back to the station."""
        twist = BACK_GAIN * pose_error(station.T_world_mrf, T_world_mrf)
        size = float(np.abs(twist).max())
        return np.asarray(twist * min(1.0, BACK_SPEED / max(size, 1e-12)))

    def is_home(self, station: Station, q: Array, p: Array, led: bool) -> bool:
        """Return whether an arm at q (n,), its MRF at p (3,), is back.

        `led` says that a goal leads its tool.
        """
        if led:
            return math.dist(p, station.T_world_mrf.p) < HOME_M
        return float(np.abs(station.q - q).max()) < HOME

    def of_outside(self, objectives: ObjectiveGains) -> ObjectiveGains:
        """Return gains of which only those that look at obstacles are left."""
        if self._outside is None or self._outside[0] is not objectives:
            gains = {
                name: gain if name in OUTSIDE else 0.0 for name, gain in objectives.gains.items()
            }
            self._outside = objectives, objectives._replace(gains=gains)
        return self._outside[1]

    def _moved(self, station: Station, q: Array, placed: Placed | None) -> float:
        """Return how far any part of the arm is from where it was told to stand [m]."""
        if station.ends is None or self._capsules is None:
            return 0.0
        ends = (placed or self._capsules.place(q[None])).ends[0]
        return math.sqrt(float(((ends - station.ends) ** 2).sum(axis=2).max()))
