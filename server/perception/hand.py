"""Following a hand: the part of the measured force that is nobody's, because it does not change.

A load or a bias that was told a little wrong reads like a light hand, below the bounds of
`unexplained_load.py`: it would lead the tool away for ever, 0.2 kg at 20 N·s/m by 0.1 m/s. A hand
is known by its changes. So what was there before the arm was enabled, and what has stayed the same
for `STAYS_S` (`HANGS_S`, where it is vertical as a weight is), is nobody's: it is not followed, as
long as nothing else is measured (`control/task/sources/following.py`). Any other wrench is followed
whole and at once. Changes below half of the deadband are the sensor's noise, no hand's.
"""

import math
from collections import deque

import numpy as np

from ...config.schema.sources.following import FollowingSection
from ..commands.settings import OperatorSettings
from ..control.spatial import GRAVITY, Array, Pose, cross, sizes
from ..control.state import Output
from ..mode import Mode
from ..runtime.events import Events
from .unexplained_load import LATCHED, LoadTrust

STAYS_S = 3.0
"""A hand does not hold the same force for so long [s]."""
HANGS_S = 1.0
"""Nor the same vertical one, which a weight is; nor is there one that presses nothing [s]."""
VERTICAL = math.cos(math.radians(10.0))
"""Cosine of the angle to the vertical within which a force may be a weight [1]."""
STEADY = 0.5
"""Within that part of the deadband of following a wrench counts as the same [1]."""
BLOCK = 5
"""The measured wrench is averaged over so many ticks [1]."""


class UnchangingForce:
    """Learns what one arm's sensor reads while nobody leads the tool."""

    def __init__(
        self,
        section: FollowingSection,
        settings: OperatorSettings,
        period_s: float,
        events: Events,
    ) -> None:
        self._settings, self._events = settings, events
        self._deadband = np.array([section.deadband, section.moment_deadband])
        self._per_s = 1.0 / (BLOCK * period_s)
        self._newest: deque[Array] = deque(maxlen=BLOCK)
        self._blocks: deque[Array] = deque(maxlen=round(STAYS_S * self._per_s))
        self._ticks = 0
        self._T_wrist_mrf: Pose | None = None
        self._learned = np.zeros(6)
        self._said = np.zeros(6)

    def update(self, output: Output | None, mode: Mode, trust: LoadTrust) -> Array | None:
        """Take in the tick before; return the wrench (6,) that is nobody's, in World axes.

        It is what the arm exerts at the MRF. None: there is none beyond the deadband, or a load
        that no contact explains is judged, or waits for an operator.
        """
        if output is None or trust is LoadTrust.JUDGED or trust in LATCHED:
            self._forget()
            return None
        if output.wrench_mrf is None:
            self._newest.clear()
            self._blocks.clear()
        else:
            self._carry(output)
            R = output.T_world_mrf_measured.R
            self._newest.append((output.wrench_mrf.reshape(2, 3) @ R.T).ravel())
            self._ticks += 1
            if self._ticks % BLOCK == 0:
                self._learn(mode.energised and trust is not LoadTrust.SETTLING)
        acts = np.array(sizes(self._learned)) > self._deadband
        if not acts.any():
            return None
        if mode is Mode.ENABLED and self._settings.on["following"]:
            self._tell()
        return np.asarray(self._learned * np.repeat(acts, 3))

    def _forget(self) -> None:
        self._newest.clear()
        self._blocks.clear()
        self._learned, self._said = np.zeros(6), np.zeros(6)

    def _carry(self, output: Output) -> None:
        """Bring what was measured at another MRF, in the Wrist, to that of now."""
        before, now = self._T_wrist_mrf, output.T_wrist_mrf
        self._T_wrist_mrf = now
        if before is None or np.array_equal(before.p, now.p):
            return
        lever = output.T_world_mrf_measured.R @ now.R.T @ (before.p - now.p)
        for wrench in (self._learned, *self._newest, *self._blocks):
            wrench[3:] += cross(lever, wrench[:3])

    def _learn(self, followed: bool) -> None:
        """Take in one more block of the newest wrenches."""
        newest = np.mean(self._newest, axis=0)
        self._blocks.append(newest)
        if not followed:
            # The brakes hold, or a load is told: what is read now is there before it is followed.
            self._learned = newest.copy()
            return
        force, up = sizes(newest)[0], abs(float(newest[2]))
        hangs = force <= self._deadband[0] or up >= VERTICAL * force
        count = round((HANGS_S if hangs else STAYS_S) * self._per_s)
        if len(self._blocks) < count:
            return
        last = np.array(self._blocks)[-count:]
        off = np.linalg.norm((last - newest).reshape(count, 2, 3), axis=2).max(axis=0)
        leads = self._settings.gains["following"].reshape(2, 3).any(axis=1)
        if not (leads & (off > STEADY * self._deadband)).any():
            self._learned = last.mean(axis=0)

    def _tell(self) -> None:
        off = np.array(sizes(self._learned - self._said))
        if not (off > self._deadband).any():
            return
        self._said = self._learned.copy()
        force, moment = sizes(self._learned)
        weight = float(self._learned[2])
        words = f"{force:.2g} N and {moment:.2g} N·m do not change, as a hand's do"
        if force > self._deadband[0] and abs(weight) >= VERTICAL * force:
            words += f"; {weight / -float(GRAVITY[2]):+.2g} kg that nobody told of would be these"
        self._events.warning("force_unchanging", words, force_n=force, moment_nm=moment)
