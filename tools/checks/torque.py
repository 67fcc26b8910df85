"""Drives in CST: is the torque law stable, and can the motors hold the arm with room to spare?"""

from collections.abc import Iterator

import numpy as np

from ...config.agree import REQUIRED_POSTURES
from ...config.load import Cell
from ...server.control.dynamics import Dynamics
from ...server.control.mechanism import Mechanism
from ...server.torque_loop import RATIOS, spectral_radius
from ..findings import Finding, graded

ROOM = 0.5
"""Part of a motor's torque that holding still may take before it is worth a word [1]."""

SWIFT = 0.98
"""Magnitude of a pole above which errors linger [1]."""


def torque(cell: Cell) -> Iterator[Finding]:
    """Judge the law and the holding torques of a cell in CST; nothing in the other modes."""
    if cell.config.mechanism.operation_mode != "cst":
        return
    gains, period = cell.config.torque, cell.config.timing.period_s
    radii = {ratio: spectral_radius(gains, period, ratio) for ratio in RATIOS}
    worst = max(radii.values())
    yield Finding(
        "torque law",
        graded(worst, SWIFT, 1.0),
        "greatest pole "
        + ", ".join(f"{r:.3f} at {ratio:g} × the modelled inertia" for ratio, r in radii.items())
        + f", stable below 1; tool lags its command by {gains.lag_s * 1e3:g} ms as stated",
        {"radius": worst, "lag_s": gains.lag_s},
    )
    mechanism = Mechanism.from_cell(cell)
    by_joint = {d.joint: d for d in cell.config.mechanism.drives}
    drives = [by_joint[j] for j in mechanism.joints]
    dynamics = Dynamics(mechanism, np.array([d.rotor_inertia for d in drives]))
    most = np.array([d.max_torque for d in drives])
    for name in REQUIRED_POSTURES:
        q = np.array(cell.config.mechanism.postures[name])
        share = np.abs(dynamics.bias(q, np.zeros(mechanism.n))) / most
        j = int(np.argmax(share))
        yield Finding(
            f"holding {name}",
            graded(float(share[j]), ROOM, 1.0),
            f"{mechanism.joints[j]} takes {share[j] * most[j]:.3g} of {most[j]:g} N·m",
            {"share": float(share[j])},
        )
