"""Stability of the torque law of drives in CST."""

from collections.abc import Iterator

from ....config.load import Cell
from ....server.stability.loops import RATIOS, spectral_radius
from ..findings import Finding, graded

SWIFT = 0.98
"""Magnitude of a pole above which errors linger [1]."""


def torque(cell: Cell) -> Iterator[Finding]:
    """Judge the law of a cell in CST; nothing in the other modes."""
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
