"""Movers of the virtual world: the platform under the arm, and the Carrier."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell
from ....config.schema.moving import RigMotionSection
from ....protocols.messages.perception.moving import RigMotion

Vector = NDArray[np.float64]

MOST_ACCELERATION = 50.0
"""Greatest acceleration of a sway, at its turning points [m/s², rad/s²]."""
_TAKE_UP = 4.0
"""Natural frequency with which a sway is taken up and laid down [rad/s]."""


@dataclass
class Mover:
    """A displacement (6,) that drifts and sways, smoothly whatever it is told."""

    dt: float
    acceleration: float
    place: Vector = field(default_factory=lambda: np.zeros(6))
    """Displacement now [m, rad]."""
    rate: Vector = field(default_factory=lambda: np.zeros(6))
    """Its rate now [m/s, rad/s]."""
    _drift: Vector = field(default_factory=lambda: np.zeros((3, 6)))
    """Displacement by the twist, its rate, and the rate that was told."""
    _sway: Vector = field(default_factory=lambda: np.zeros((3, 6)))
    """Amplitude of the sway, its rate, and the amplitude that was told."""
    _phase: float = 0.0
    _period_s: float = 4.0

    def move(self, motion: RigMotion | RigMotionSection) -> None:
        """Move like this from now on."""
        self._drift[2], self._sway[2] = motion.twist, motion.sway
        self._period_s = motion.period_s

    def step(self) -> None:
        """Advance by one physics step."""
        dt, drift, sway = self.dt, self._drift, self._sway
        most = self.acceleration * dt
        drift[1] += np.clip(drift[2] - drift[1], -most, most)
        drift[0] += drift[1] * dt
        sway[1] += dt * (_TAKE_UP**2 * (sway[2] - sway[0]) - 2.0 * _TAKE_UP * sway[1])
        sway[0] += sway[1] * dt
        self._phase += 2.0 * math.pi * dt / self._period_s
        place = drift[0] + sway[0] * math.sin(self._phase)
        self.rate = (place - self.place) / dt
        self.place = place


class Movers:
    """All of a cell's movers by name: `platform` where Base may move, `carrier` where it may."""

    def __init__(self, cell: Cell) -> None:
        rig, frames = cell.config.rig, cell.config.frames
        if rig is None:
            raise ValueError(f"cell {cell.config.name} has no [rig]: nothing to simulate")
        rolls = cell.config.mechanism.base is not None
        there = {"platform": None if rolls else frames.base, "carrier": frames.carrier}
        self.by_name = {
            name: Mover(rig.physics_step_s, rig.frames.acceleration)
            for name, frame in there.items()
            if frame is not None
        }
        for name, mover in self.by_name.items():
            mover.move(getattr(rig.frames, name))

    def move(self, motion: RigMotion) -> None:
        """Move one of them.

        Raises `ValueError`, in one line, where the cell has it not, and for a sway that is absurd.
        """
        if motion.target not in self.by_name:
            table = {"platform": "frames.base", "carrier": "frames.carrier"}[motion.target]
            raise ValueError(f"motion: no {motion.target} in a cell without [{table}]")
        peak = max(abs(x) for x in motion.sway) * (2.0 * math.pi / motion.period_s) ** 2
        if peak > MOST_ACCELERATION:
            raise ValueError(
                f"motion: a sway of {max(abs(x) for x in motion.sway):g} in {motion.period_s:g} s "
                f"accelerates by {peak:.3g}: must be at most {MOST_ACCELERATION:g} m/s², rad/s²"
            )
        self.by_name[motion.target].move(motion)

    def step(self) -> None:
        """Advance all by one physics step."""
        for mover in self.by_name.values():
            mover.step()
