"""Check of the gains against the stiffest environment, with the loop's delay."""

from collections.abc import Iterator

from ....config.load import Cell
from ....server.stability.force_loop import bound, force_axis
from ....server.stability.gains import error_delay_periods
from ....server.stability.payloads import PayloadBounds, payload_words
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
    for i, (name, gain) in enumerate(zip(AXES, cell.config.sources.force.gain, strict=True)):
        axis = force_axis(cell, i, gain)
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
    yield from _payload(cell)


def _payload(cell: Cell) -> Iterator[Finding]:
    """Judge whether force control swings the tool by its payload's inertia."""
    gain = max(cell.config.sources.force.gain[:3])
    name, mass = max(payloads(cell).items(), key=lambda item: item[1])
    if gain <= 0.0 or mass <= 0.0:
        return
    bound = PayloadBounds(cell).force / gain
    yield Finding(
        "force payload",
        graded(mass, COMFORT * bound, bound),
        f"{name} of {mass:g} kg, the tool stands by itself {payload_words(bound)} "
        f"at K_F = {gain:g} m/s/N",
        {"payload": mass, "bound": bound},
    )


def _grade(gain: float, loop_gain: float, limit: float) -> Severity:
    # A negative gain drives the arm away from its target or further into the wall.
    return Severity.ERROR if gain < 0.0 else graded(loop_gain, COMFORT * limit, limit)
