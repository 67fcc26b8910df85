"""Following a hand, and nobody's force: a hand changes, a load that was told wrong does not.

What the sensor reads too much or too little by, below the bounds of `unexplained_load.py`, would
lead the tool away for ever: 0.2 kg at 20 N·s/m by 0.1 m/s. So a force is a hand's only if it has
changed since following began, and as long as it goes on changing: what stays the same for
`STAYS_S`, or `HANGS_S` if it is vertical as a weight is, moves the tool by `SLOW` at most until it
changes again. Changes below the deadband of following are noise, and so is a force below it.
"""

import math
from collections import deque

import numpy as np

from ....config.schema.sources.following import FollowingSection
from ...commands.settings import OperatorSettings
from ...control.spatial import GRAVITY, Array, sizes
from ...control.state import Output
from ...mode import Mode
from ...runtime.events import Events

SLOW = (3e-3, 15e-3)
"""So quick a force that does not change may lead the tool [m/s, rad/s]."""
STAYS_S = 3.0
"""A hand does not hold the same force for so long [s]."""
HANGS_S = 1.0
"""Nor the same vertical one, which a weight is [s]."""
VERTICAL = math.cos(math.radians(10.0))
"""Cosine of the angle to the vertical within which a force may be a weight [1]."""
SETTLE_S = 0.3
"""What is measured while brakes open, and so long after, is none that has changed [s]."""
BLOCK = 5
"""The measured wrench is averaged over so many ticks [1]."""
STEADY = 0.05
"""A force changes beside the deadband by that part of it [1]."""


class HandMonitor:
    """Tells how much of the measured force is to be followed by one arm."""

    def __init__(
        self,
        section: FollowingSection,
        settings: OperatorSettings,
        period_s: float,
        events: Events,
    ) -> None:
        self._settings, self._period_s, self._events = settings, period_s, events
        self._deadband = np.array([section.deadband, section.moment_deadband])
        self._damping = np.array([section.damping, section.angular_damping])
        self._newest: deque[Array] = deque(maxlen=BLOCK)
        self._blocks: deque[Array] = deque(maxlen=round(STAYS_S / (BLOCK * period_s)))
        self._forget()

    def _forget(self) -> None:
        self._newest.clear()
        self._blocks.clear()
        self._kept: Array | None = None
        """The wrench (6,) in World axes that does not change; None while it does."""
        self._since_s, self._ticks, self._said = 0.0, 0, False

    def update(self, output: Output | None, mode: Mode) -> tuple[float, bool]:
        """Take in the tick before; return the share to follow, and whether that acts at once."""
        settings = self._settings
        if mode is not Mode.ENABLED or not settings.on["following"]:
            self._forget()
            return 1.0, False
        if output is None or output.wrench_mrf is None:
            return self._share(), False
        R = output.T_world_mrf_measured.R
        self._newest.append((output.wrench_mrf.reshape(2, 3) @ R.T).ravel())
        self._since_s += self._period_s
        mean = np.mean(self._newest, axis=0)
        self._ticks += 1
        if self._ticks % BLOCK == 0:
            self._blocks.append(mean)
        if self._since_s < SETTLE_S:
            self._kept = mean
            share = self._share()
            return share, share < 1.0
        if self._kept is not None:
            if self._changed(mean, self._kept):
                self._kept, self._said = None, False
                self._blocks.clear()
                return 1.0, True
        elif self._ticks % BLOCK == 0 and self._stays():
            self._kept = self._blocks[-1]
        share = self._share()
        if share < 1.0 and not self._said and self._kept is not None:
            self._said = True
            self._tell(self._kept)
        return share, False

    def _changed(self, wrench: Array, before: Array) -> bool:
        """Return whether a wrench (6,) is another one than before, beyond noise."""
        off, size = np.array(sizes(wrench - before)), np.array(sizes(before))
        followed = self._settings.gains["following"].reshape(2, 3).any(axis=1)
        return bool((followed & (off > np.maximum(self._deadband, STEADY * size))).any())

    def _stays(self) -> bool:
        """Return whether the wrench has stayed the same for as long as no hand's does."""
        newest = self._blocks[-1]
        force, up = sizes(newest)[0], abs(float(newest[2]))
        lasts_s = HANGS_S if up >= VERTICAL * force else STAYS_S
        count = round(lasts_s / (BLOCK * self._period_s))
        if len(self._blocks) < count:
            return False
        last = [*self._blocks][-count:]
        return not any(self._changed(block, newest) for block in last)

    def _share(self) -> float:
        """Return the share that moves the tool slowly by a force that stays; all of another one."""
        if self._kept is None:
            return 1.0
        size = np.array(sizes(self._kept))
        size[size <= self._deadband] = 0.0
        gains = self._settings.gains["following"].reshape(2, 3).max(axis=1)
        speeds = np.maximum(gains * size / self._damping, 1e-12)
        return float(min(1.0, (np.array(SLOW) / speeds).min()))

    def _tell(self, wrench: Array) -> None:
        force = sizes(wrench)[0]
        self._events.warning(
            "force_unchanging",
            f"{force:.2g} N do not change, as no hand's do: they are followed by "
            f"{1e3 * SLOW[0]:g} mm/s until they do. Were they a weight, it would be "
            f"{float(wrench[2]) / -float(GRAVITY[2]):.2g} kg that nobody told of",
            force_n=force,
            force_world=str(np.round(wrench[:3], 2).tolist()),
        )
