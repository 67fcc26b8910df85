"""Stability of the torque law with its delay, and with an inertia that differs from the model's.

One axis of the law in its own terms: a unit inertia as the law believes, `ratio` times that in
truth, a torque that acts one period late and is held for a period, the prediction over that delay,
and the momentum observer.
"""

import numpy as np

from ...config.schema.mechanism.torque import TorqueSection
from ..control.spatial import Array

RATIOS = (0.5, 1.0, 2.0)
"""True inertia over the modelled one, for which the loop has to be stable [1]."""


_HALVINGS = 12
"""Bisections of the stable range [1]."""


def spectral_radius(gains: TorqueSection, period_s: float, ratio: float) -> float:
    """Return the greatest magnitude of the sampled loop's poles: stable below 1.

    The pole at 1 that an observer of bandwidth 0 leaves is not counted.
    """
    A = np.array([_step(column, gains, period_s, ratio) for column in np.eye(5)]).T
    if gains.observer == 0.0:
        A = A[:4, :4]
    return float(np.abs(np.linalg.eigvals(A)).max())


def lightest_ratio(gains: TorqueSection, period_s: float) -> float:
    """Return the least true inertia over the modelled one with which the loop is stable [1]."""
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        ratio = 0.5 * (low + high)
        stable = spectral_radius(gains, period_s, ratio) < 1.0
        low, high = (low, ratio) if stable else (ratio, high)
    return high


def _step(s: Array, gains: TorqueSection, T: float, ratio: float) -> Array:
    """Return error, rate, torque that acts, torque that acted, momentum: one period later."""
    x, v, sent, acted, expected = s
    expected = expected + T * acted
    r = gains.observer * (v - expected) / (1.0 + gains.observer * T)
    a = sent + r
    torque = -gains.stiffness * (x + T * (v + 0.5 * T * a)) - gains.damping * (v + T * a) - r
    true = sent / ratio
    return np.array([x + T * (v + 0.5 * T * true), v + T * true, torque, sent, expected + T * r])
