"""Check of the gains against the stiffest environment, with the loop's delay."""

from collections.abc import Iterator

import numpy as np

from ....config.load import Cell
from ....config.schema.section import Vector6
from ....server.stability.judgement import PayloadBounds, error_delay_periods, payload_words
from ....server.stability.loops import ForceLoop, bound
from ..findings import Finding, Severity, Value, graded
from .following import payloads

COMFORT = 0.5
"""Part of the bound above which contact overshoots noticeably [1]."""
AXES = ("x", "y", "z", "rx", "ry", "rz")


def stability(cell: Cell) -> Iterator[Finding]:
    """Judge gains of a pose error, and the force gains per axis with their delay part by part."""
    period = cell.config.timing.period_s
    for source, section in cell.config.sources.each.items():
        if section.ERROR_GAIN is None or (section.NEEDS == "camera" and not cell.config.cameras):
            continue
        delay, worst = error_delay_periods(cell, section), max(section.gain) * period
        why = ", a picture's stamp being wrong by an interval between two"
        yield Finding(
            f"{source} gain",
            _grade(min(section.gain), worst, bound(delay)),
            f"{section.ERROR_GAIN} T = {worst:.3g}, stable below {bound(delay):.3g} at d = "
            f"{delay:g} periods" + (why if section.NEEDS == "camera" else ""),
            {"loop_gain": worst, "bound": bound(delay)},
        )
    if cell.config.mechanism.force_torque is None:
        yield Finding("force gain", Severity.OK, "no force/torque sensor, so no force loop")
        return
    loop, gains = ForceLoop(cell), cell.config.sources.force.gain
    for name, gain, axis in zip(AXES, gains, loop.axes(gains), strict=True):
        if axis is None:
            yield Finding(f"force gain {name}", Severity.OK, "the arm cannot move along this axis")
            continue
        loop_gain = gain * axis.stiffness * period
        values: dict[str, Value] = {
            "loop_gain": loop_gain,
            "bound": axis.bound,
            "delay_periods": axis.delay_periods,
        }
        yield Finding(
            f"force gain {name}",
            _grade(gain, loop_gain, axis.bound),
            f"K_F k_e T = {gain:g} · {axis.stiffness:g} · {period:g} = {loop_gain:.3g}, stable "
            f"below {axis.bound:.3g} at d = {axis.delay_periods:.2f} periods ("
            + ", ".join(f"{part} {delay:.2f}" for part, delay in axis.delays.items())
            + ")",
            values | {f"delay_{n.replace(' ', '_')}": v for n, v in axis.delays.items()},
        )
    yield from _tool(loop, gains)
    yield from _payload(cell, loop, gains)


def _tool(loop: ForceLoop, gains: Vector6) -> Iterator[Finding]:
    """Judge force control where the tool touches away from its tip, and so turns."""
    contact = loop.touching(gains)
    if contact.lever == 0.0:
        return
    yield Finding(
        "force tool",
        Severity.OK if contact.share < 1.0 else Severity.ERROR,
        f"touched {contact.lever:.3g} m from the MRF, where K_F + K_R r² acts: loop gain "
        f"{contact.loop_gain:.3g}, stable below {contact.bound:.3g}"
        + ("" if contact.share < 1.0 else "; lower gains about its axes, or a contact_length"),
        {"lever_m": contact.lever, "loop_gain": contact.loop_gain, "bound": contact.bound},
    )


def _payload(cell: Cell, loop: ForceLoop, gains: Vector6) -> Iterator[Finding]:
    """Judge whether force control swings the tool by its payload's inertia."""
    name, mass, gain = "", 0.0, 0.0
    for each, payload in payloads(cell).items():
        gives = loop.gives(gains, np.array(payload.com))
        if payload.mass * gives > mass * gain:
            name, mass, gain = each, payload.mass, gives
    if gain <= 0.0 or mass <= 0.0:
        return
    bound = PayloadBounds(cell).force / gain
    yield Finding(
        "force payload",
        graded(mass, COMFORT * bound, bound),
        f"{name} of {mass:g} kg, the tool stands by itself {payload_words(bound)} "
        f"at K_F = {gain:.3g} m/s/N where its mass is",
        {"payload": mass, "bound": bound},
    )


def _grade(gain: float, loop_gain: float, limit: float) -> Severity:
    # A negative gain drives the arm away from its target or further into the wall.
    return Severity.ERROR if gain < 0.0 else graded(loop_gain, COMFORT * limit, limit)
