"""Check of force reflection over the expected network: stability and timeouts."""

from collections.abc import Iterator

import numpy as np

from ....config.load import Cell
from ....config.schema.network import ReflectionSection
from ....protocols.topics import KEEPALIVE
from ....server.reflection import pose_stiffness
from ...reflect.small_gain import ARM_S, FILTER_PER_GAIN, GREATEST, HeldStick
from ..findings import Finding, Severity

PER_HAND = 0.75
"""Reflected stiffness that settles at every delay to 0.5 s, as a part of the hand's own [1].

Measured on `pa10_reflect` (`tests/campaign/contact/reflection_trial.py`), with 20 % jitter and 5 %
loss: hands of 100, 200 and 400 N/m settle at this part of theirs and below it (the campaign's part
`reflection` shows the second); at the whole of it the second and third do not at every delay.
"""
STIFFEST = 300.0
"""Stiffest reflection that was measured to settle [N/m]."""
LOST = 3
"""Messages in a row that may be lost before a timeout [1]."""


def reflection(cell: Cell) -> Iterator[Finding]:
    """Judge rate mode by its loop gain, pose mode by its stiffness, timeouts by the round trip."""
    config = cell.config.reflection
    if config is None:
        return
    yield _rate(cell, config)
    yield _pose(cell, config)
    yield from _timeouts(cell, config)


def _rate(cell: Cell, config: ReflectionSection) -> Finding:
    stick = HeldStick.of(config.handle, config.hand)
    k_fr, k_hc = max(config.gain[:3]), max(cell.config.sources.joystick.gain[:3])
    k_f = min(cell.config.sources.force.gain[:3])
    if k_f <= 0.0:
        text = "K_F is not above 0 along every axis: no law binds the force that is reflected"
        return Finding("reflection, rate", Severity.ERROR, text, {"force_gain": k_f})
    gain = k_fr * stick.rate_per_force * k_hc / k_f
    filter_s = stick.filter_s(gain, config.largest_round_trip_s)
    text = (
        f"g = K_FR c K_HC / K_F = {k_fr:g} · {stick.rate_per_force:.3g} · {k_hc:g} / {k_f:g} = "
        f"{gain:.3g}; at ζ = {stick.damping_ratio:.2f}, up to {stick.bound:g} needs no filter"
    )
    if filter_s > 0.0:
        text += (
            f", up to {GREATEST:g} one of {FILTER_PER_GAIN:g} g (RTT + {ARM_S + stick.lag_s:.2f} s)"
            f" = {filter_s:.2f} s at {config.largest_round_trip_s:g} s"
        )
    return Finding(
        "reflection, rate",
        Severity.OK if gain <= GREATEST else Severity.ERROR,
        text,
        {"loop_gain": gain, "bound": stick.bound, "greatest": GREATEST, "filter_s": filter_s},
    )


def _pose(cell: Cell, config: ReflectionSection) -> Finding:
    sources, sensor = cell.config.sources, cell.config.mechanism.force_torque
    contact = 1.0 if sensor is None else sensor.stiffest_environment
    limit = min(PER_HAND * config.hand.stiffness, STIFFEST)
    full = pose_stiffness(
        np.array(config.gain),
        1.0,
        np.array(sources.force.gain),
        np.array(sources.position.gain),
        contact,
    )
    lowered = f"K_FR is lowered to it from a clutch scale of {config.stiffness / full:.2g} on"
    return Finding(
        "reflection, pose",
        Severity.OK if config.stiffness <= limit else Severity.ERROR,
        f"{config.stiffness:g} N/m, settles at every delay up to {limit:g} N/m with a hand of "
        f"{config.hand.stiffness:g} N/m" + (f"; {lowered}" if full > config.stiffness else ""),
        {"stiffness": config.stiffness, "limit": limit, "at_scale_1": full},
    )


def _timeouts(cell: Cell, config: ReflectionSection) -> Iterator[Finding]:
    timing = cell.config.timing
    worst_s = config.largest_round_trip_s * (1.0 + config.jitter)
    varies_s = config.largest_round_trip_s * config.jitter
    lost_s, keepalive_s = LOST * timing.period_s, LOST / (KEEPALIVE.rate_hz or 1.0)
    for what, timeout_s, least_s in (
        ("command age", timing.max_command_age_s, worst_s + lost_s),
        ("lease", timing.lease_timeout_s, worst_s + keepalive_s),
        ("stream", timing.stream_timeout_s, varies_s + lost_s),
    ):
        yield Finding(
            f"distant {what}",
            Severity.OK if timeout_s >= least_s else Severity.ERROR,
            f"timeout {timeout_s * 1e3:g} ms, at least {least_s * 1e3:g} ms for a round trip of "
            f"{config.largest_round_trip_s * 1e3:g} ms ± {config.jitter:.0%} and {LOST} losses",
            {"timeout_s": timeout_s, "least_s": least_s},
        )
