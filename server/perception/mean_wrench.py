"""Moving average of the measured wrench, in World axes."""

from dataclasses import dataclass

import numpy as np

from ..control.spatial import Array, Pose, sizes
from ..control.state import Output

AVERAGE_S = 0.2
"""The measured wrench is averaged over this time [s]."""
NEWEST = 5
"""And over so many ticks where it is to be known how it changes [1]."""


@dataclass(frozen=True)
class WrenchMark:
    """Pose of the tool, and the wrench that was measured there."""

    T: Pose
    sizes: Array
    """Of force and moment (2,) [N, N·m]."""
    directions: Array
    """Unit vectors of both in World (2, 3)."""


class AveragedWrench:
    """Average of the newest wrenches; below `bounds` (2,) [N, N·m] the tool counts as unloaded."""

    def __init__(self, bounds: Array, period_s: float) -> None:
        self._bounds = bounds
        self._rows = np.zeros((max(2, round(AVERAGE_S / period_s)), 6))
        """The newest wrenches, the last of them last."""
        self._count = 0

    @property
    def known(self) -> bool:
        """True once there is a reading."""
        return self._count > 0

    def clear(self) -> None:
        """Forget: the sensor is stale."""
        self._count = 0

    def add(self, wrench_mrf: Array, output: Output) -> None:
        """Take in the wrench (6,) of a tick, in MRF axes."""
        R, rows = output.T_world_mrf_measured.R, self._rows
        rows[:-1] = rows[1:]
        rows[-1] = (wrench_mrf.reshape(2, 3) @ R.T).ravel()
        self._count = min(self._count + 1, len(rows))

    def mean(self) -> Array:
        """Return the mean wrench (6,)."""
        return self._mean(self._count)

    def now(self) -> Array:
        """Return the mean wrench (6,) of the last few ticks."""
        return self._mean(min(self._count, NEWEST))

    def mark(self, output: Output) -> WrenchMark:
        """Return where the tool is, and what is measured now."""
        mean = self.now()
        size = np.array(sizes(mean))
        directions = mean.reshape(2, 3) / np.maximum(size, 1e-9)[:, None]
        return WrenchMark(output.T_world_mrf_measured, size, directions)

    def sizes(self) -> Array:
        """Return the sizes (2,) of mean force and moment [N, N·m]."""
        return np.array(sizes(self.mean()))

    def quiet(self) -> bool:
        """Return whether neither is beyond its bound."""
        return self.known and bool((self.sizes() <= self._bounds).all())

    def _mean(self, newest: int) -> Array:
        """Return the mean (6,) of so many wrenches, nothing of none."""
        return np.asarray(self._rows[-newest:].mean(axis=0)) if newest else np.zeros(6)
