"""Following a hand: how late the arm is, and how stiff a hand may hold it."""

from collections.abc import Iterator

from ...config.load import Cell
from ...server.hand import delays, stiffest_hand
from ..findings import Finding, Status, graded

COMFORT = 0.5
"""Part of the bound above which a hand feels the arm swing [1]."""


def following(cell: Cell) -> Iterator[Finding]:
    """Judge the delay of following against the stiffest hand; nothing where it is switched off."""
    source, mechanism = cell.config.sources.following, cell.config.mechanism
    if not source.enabled or mechanism.force_torque is None:
        return
    parts = delays(cell)
    lag_s = sum(parts.values()) * cell.config.timing.period_s
    share = max(source.gain[:3])
    yield Finding(
        "following lag",
        Status.OK,
        f"{lag_s * 1e3:.1f} ms behind the hand ("
        + ", ".join(f"{part} {delay:.2f}" for part, delay in parts.items())
        + f" periods), then M/B = {source.mass / source.damping * 1e3:g} ms",
        {"lag_s": lag_s},
    )
    bound = stiffest_hand(cell, share)
    yield Finding(
        "following hand",
        graded(source.stiffest_hand, COMFORT * bound, bound),
        f"{source.stiffest_hand:g} N/m expected, stable below {bound:.3g} N/m",
        {"stiffest_hand": source.stiffest_hand, "bound": bound},
    )
