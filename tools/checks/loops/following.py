"""Check of following a hand: the arm's delay, and the stiffest hand that it bears."""

from collections.abc import Iterator

from ....config.load import Cell
from ....config.schema.mechanism import PayloadSection
from ....server.stability.judgement import PayloadBounds, payload_words
from ....server.stability.loops import ForceLoop, delays, stiffest_hand
from ..findings import Finding, Severity, graded

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
        Severity.OK,
        f"{lag_s * 1e3:.1f} ms behind the hand ("
        + ", ".join(f"{part} {delay:.2f}" for part, delay in parts.items())
        + f" periods), then M/B = {source.mass / source.damping * 1e3:g} ms",
        {"lag_s": lag_s},
    )
    carried = {name: payload.mass for name, payload in payloads(cell).items()}
    name, mass = max(carried.items(), key=lambda item: item[1])
    # The heaviest one is felt latest.
    turning = max(source.gain[3:]) * ForceLoop(cell).lever() ** 2
    bound = stiffest_hand(cell, share, mass, turning)
    yield Finding(
        "following hand",
        graded(source.stiffest_hand, COMFORT * bound, bound),
        f"{source.stiffest_hand:g} N/m expected, stable below {bound:.3g} N/m with {name}",
        {"stiffest_hand": source.stiffest_hand, "bound": bound},
    )
    heaviest = PayloadBounds(cell).following
    yield Finding(
        "following payload",
        graded(mass, COMFORT * heaviest, heaviest),
        f"{name} of {mass:g} kg, the tool stands by itself {payload_words(heaviest)} at M = "
        f"{source.mass:g} kg, B = {source.damping:g} N·s/m",
        {"payload": mass, "bound": heaviest},
    )


def payloads(cell: Cell) -> dict[str, PayloadSection]:
    """Return all that a cell may carry by name."""
    mechanism = cell.config.mechanism
    own = {} if mechanism.force_torque is None else {"payload": mechanism.force_torque.payload}
    return own | {f"payload {name}": p for name, p in mechanism.payloads.items()}
