"""Where a base on wheels is: odometry of the commanded and of the measured wheels. Pure.

The pose of the base is no function of the wheels' angles, so it is carried on from tick to tick.
The commanded base is what all is computed with; the measured one lags it as the joints do. News of
where Base is corrects both alike, by a little each tick.
"""

from typing import NamedTuple

import numpy as np

from ..frame_tree import Body
from ..spatial import Array, Pose, pose_error, rotation_exp, sizes
from .rolling import Rolled, Rolling


class Odometry(NamedTuple):
    """Where the base is, by its wheels."""

    commanded: Rolled
    measured: Rolled
    drift: Array
    """Correction still to be made (6,): a turn about the measured base, World axes [m, rad]."""

    @staticmethod
    def at(T_world_base: Pose, wheels: Array) -> "Odometry":
        """Return that of a base whose wheels stand at angles (2,) [rad]."""
        rolled = Rolled.at(T_world_base, wheels)
        return Odometry(rolled, rolled, np.zeros(6))

    def rolled(self, rolling: Rolling, commanded: Array | None, measured: Array) -> "Odometry":
        """Return it with the wheels at these angles (2,) [rad], commanded and measured.

        None of a base that is not commanded: it is where it is measured.
        """
        found = rolling.roll(self.measured, measured)
        if commanded is None:
            return self._replace(commanded=found, measured=found)
        return self._replace(commanded=rolling.roll(self.commanded, commanded), measured=found)

    def forget(self, commanded: Array, measured: Array) -> "Odometry":
        """Return it with wheels whose counts began anew: the base has not moved by that."""
        return self._replace(
            commanded=Rolled.at(self.measured, commanded),
            measured=Rolled.at(self.measured, measured),
        )

    def seen(self, T_then: Pose, T_world_base: Pose) -> "Odometry":
        """Return it with news of where Base was, when the odometry had it at `T_then`."""
        return self._replace(drift=pose_error(T_world_base, T_then))

    def corrected(self, most: tuple[float, float], period_s: float) -> tuple["Odometry", Array]:
        """Return it a period further on its way to what news said, and the twist (6,) of that.

        The twist is that of the commanded base, at its origin in World axes; it is at most `most`
        [m/s], [rad/s].
        """
        if not np.count_nonzero(self.drift):
            return self, np.zeros(6)
        off, turned = sizes(self.drift)
        shares = [
            min(1.0, bound * period_s / max(size, 1e-12))
            for size, bound in zip((off, turned), most, strict=True)
        ]
        step = self.drift * np.repeat(shares, 3)
        turn, about = rotation_exp(step[3:]), self.measured.p

        def moved(at: Rolled) -> Rolled:
            p = about + step[:3] + turn @ (at.p - about)
            return Rolled.at(Pose(turn @ at.R, p), at.wheels)

        commanded = moved(self.commanded)
        twist = np.concatenate((commanded.p - self.commanded.p, step[3:])) / period_s
        found = Odometry(commanded, moved(self.measured), self.drift - step)
        return found, twist

    def body(self, twist: Array) -> Body:
        """Return the commanded base as what moves of itself only as far as it is corrected."""
        return Body(self.commanded, twist)
