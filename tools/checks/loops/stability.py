"""Do the gains stay stable against the stiffest environment, with the delay that the loop has?"""

from collections.abc import Iterator

from ....config.load import Cell
from ....server.stability.force_loop import (
    BUS_PERIODS,
    DRIVE_PERIODS,
    bound,
    force_axis,
    vision_periods,
)
from ....server.stability.payloads import PayloadBounds, payload_words
from ..findings import Finding, Status, Value, graded
from .following import payloads

COMFORT = 0.5
"""Part of the bound above which contact overshoots noticeably [1]."""
AXES = ("x", "y", "z", "rx", "ry", "rz")


def stability(cell: Cell) -> Iterator[Finding]:
    """Judge the force gains per axis, with the delay stated part by part, and K_P."""
    period = cell.config.timing.period_s
    position_bound = bound(BUS_PERIODS + DRIVE_PERIODS)
    worst = max(cell.config.sources.position.gain) * period
    yield Finding(
        "position gain",
        _grade(min(cell.config.sources.position.gain), worst, position_bound),
        f"K_P T = {worst:.3g}, stable below {position_bound:.3g} at d = "
        f"{BUS_PERIODS + DRIVE_PERIODS:g} periods",
        {"loop_gain": worst, "bound": position_bound},
    )
    if cell.config.cameras:
        gains, delay = cell.config.sources.vision.gain, vision_periods(cell)
        yield Finding(
            "vision gain",
            _grade(min(gains), max(gains) * period, bound(delay)),
            f"K_V T = {max(gains) * period:.3g}, stable below {bound(delay):.3g} at d = {delay:g} "
            "periods, a picture's stamp being wrong by an interval between two",
            {"loop_gain": max(gains) * period, "bound": bound(delay)},
        )
    if cell.config.mechanism.force_torque is None:
        yield Finding("force gain", Status.OK, "no force/torque sensor, so no force loop")
        return
    for i, (name, gain) in enumerate(zip(AXES, cell.config.sources.force.gain, strict=True)):
        axis = force_axis(cell, i, gain)
        if axis is None:
            yield Finding(f"force gain {name}", Status.OK, "the arm cannot move along this axis")
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


def _grade(gain: float, loop_gain: float, limit: float) -> Status:
    # A negative gain drives the arm away from its target or further into the wall.
    return Status.ERROR if gain < 0.0 else graded(loop_gain, COMFORT * limit, limit)
