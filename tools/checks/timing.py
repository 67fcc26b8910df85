"""Check of periods and timeouts: their order makes silence safe."""

from collections.abc import Iterator
from itertools import pairwise

from ...config.load import Cell
from ...protocols.topics import JOYSTICK, KEEPALIVE
from .findings import Finding, Severity

FRESH = 2.0
"""A timeout spans at least this many of the periods that it watches."""


def timing(cell: Cell) -> Iterator[Finding]:
    """Judge the chain of timeouts, and each timeout against the period of what it watches."""
    t = cell.config.timing
    chain = {
        "period": t.period_s,
        "tolerated overruns": t.tolerated_overruns * t.period_s,
        "setpoint timeout": t.setpoint_timeout_s,
        "heartbeat timeout": t.heartbeat_timeout_s,
        "lease timeout": t.lease_timeout_s,
    }
    broken = [f"{a} is not below {b}" for a, b in pairwise(chain) if chain[a] >= chain[b]]
    order = " < ".join(f"{name} {seconds * 1e3:g} ms" for name, seconds in chain.items())
    yield Finding(
        "timeouts",
        Severity.ERROR if broken else Severity.OK,
        f"{order}: {'; '.join(broken)}" if broken else order,
        {name.replace(" ", "_") + "_s": seconds for name, seconds in chain.items()},
    )
    yield _watch("heartbeat", t.heartbeat_timeout_s, t.heartbeat_period_s)
    yield _at_least("heartbeat period", t.heartbeat_period_s, t.period_s, "the tick produces it")
    yield _watch("lease", t.lease_timeout_s, 1.0 / (KEEPALIVE.rate_hz or 1.0))
    yield _watch("stream", t.stream_timeout_s, 1.0 / (JOYSTICK.rate_hz or 1.0))


def sampling(cell: Cell) -> Iterator[Finding]:
    """Judge the timeouts of an arm's sensor against its rate."""
    sensor = cell.config.mechanism.force_torque
    if sensor is not None:
        sample_s = 1.0 / sensor.rate_hz
        yield _watch("force/torque", sensor.timeout_s, max(sample_s, cell.config.timing.period_s))
        yield _at_least(
            "sample halves",
            sample_s,
            sensor.pairing_window_s,
            "or halves of two samples could be taken for one",
        )


def _watch(what: str, timeout_s: float, period_s: float) -> Finding:
    fits = timeout_s >= FRESH * period_s
    return Finding(
        f"{what} watch",
        Severity.OK if fits else Severity.ERROR,
        f"timeout {timeout_s * 1e3:g} ms, at least {FRESH:g} periods of {period_s * 1e3:g} ms",
        {"timeout_s": timeout_s, "period_s": period_s},
    )


def _at_least(what: str, value_s: float, bound_s: float, why: str) -> Finding:
    return Finding(
        what,
        Severity.OK if value_s >= bound_s else Severity.ERROR,
        f"{value_s * 1e3:g} ms, at least {bound_s * 1e3:g} ms: {why}",
        {"value_s": value_s, "bound_s": bound_s},
    )
