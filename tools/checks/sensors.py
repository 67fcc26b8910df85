"""Check of sensor keys: greatest effect on the arm of news without a lease."""

import math
from collections.abc import Iterator

import numpy as np

from ...config.load import Cell
from ...config.schema.surroundings import MovingFrameSection
from ...server.control.mechanism.model import Mechanism
from .findings import Finding, Severity, Value

GRAVITY = 9.81
"""[m/s²]."""


def sensors(cell: Cell) -> Iterator[Finding]:
    """Tell for each sensor key what its news can move, and how fast at most."""
    for name, frame in cell.config.frames.moving.items():
        yield _frame(cell, name, frame)
    if cell.cameras:
        yield _pictures(cell)
    yield _obstacles(cell)


def reach(cell: Cell) -> float:
    """Return how far from Base the MRF of the cell can be at most [m]."""
    mechanism, mrf = Mechanism.from_cell(cell), cell.config.mechanism.T_wrist_mrf
    model = mechanism.model
    ways = [p.translation for p in list(model.jointPlacements)[1:]]
    ways += [model.frames[mechanism.tip].placement.translation, np.array(mrf.xyz)]
    return float(sum(np.linalg.norm(way) for way in ways))


def _frame(cell: Cell, name: str, frame: MovingFrameSection) -> Finding:
    limits = cell.config.limits
    far, turned = frame.extent or (math.inf, math.inf)
    lever = reach(cell)
    if name == "carrier":
        mechanism = cell.config.mechanism
        lever += math.dist(cell.config.frames.T_world_carrier.xyz, mechanism.T_world_base.xyz) + far
    speed = min(limits.speed, frame.speed + frame.angular_speed * lever)
    text = (
        f"believed up to {frame.speed:g} m/s, {frame.angular_speed:g} rad/s, "
        f"{frame.acceleration:g} m/s², {frame.angular_acceleration:g} rad/s²"
    )
    text += f", within {far:g} m, {turned:g} rad" if frame.extent else ", anywhere"
    led = "keeps still in World" if name == "base" else "keeps to it"
    text += f": moves a tool that {led} at up to {speed:.2g} m/s"
    values: dict[str, Value] = {
        "speed": frame.speed,
        "acceleration": frame.acceleration,
        "tool_speed": speed,
    }
    if frame.extent is not None:
        values |= {"extent": far, "angular_extent": turned}
    sensor = cell.config.mechanism.force_torque
    if name == "base" and sensor is not None:
        mass = max(
            [sensor.payload.mass, *(p.mass for p in cell.config.mechanism.payloads.values())]
        )
        force = mass * (2.0 * GRAVITY * math.sin(0.5 * min(turned, math.pi)) + frame.acceleration)
        text += f", and makes up a force of {force:.2g} N"
        values["force"] = force
    status = Severity.OK
    if frame.extent is None:
        status, text = Severity.WARN, f"{text}; without an 'extent', as far as the arm reaches"
    return Finding(f"news of {name}", status, text, values)


def _pictures(cell: Cell) -> Finding:
    vision = cell.config.sources.vision
    text = (
        "move nothing until a view is stored and the source is on; then the tool at up to "
        f"{vision.speed:g} m/s, {vision.angular_speed:g} rad/s"
    )
    return Finding("pictures", Severity.OK, text, {"speed": vision.speed})


def _obstacles(cell: Cell) -> Finding:
    config = cell.config
    led = config.redundancy.field > 0.0 or config.redundancy.spheres > 0.0
    rate = 0.0
    if led:
        rate = config.redundancy.max_rate * max(d.max_velocity for d in config.mechanism.drives)
    text = (
        "stops, slows and turns aside what is asked for" if config.keeps_clear else "stops nothing"
    )
    standing, reach = config.avoidance.standing, config.avoidance.standing_reach
    if standing != "stand":
        way = "steps aside" if standing == "step_aside" else "makes way by self-motion"
        held = ", in HOLD too" if config.avoidance.standing_in_hold else ""
        text += f"; an arm that stands {way}, no part of it by more than {reach:g} m{held}"
    text += f"; self-motion at up to {rate:.2g} rad/s" if led else ""
    if standing == "stand" and not led:
        text += "; moves no idle arm"
    link = config.potential.virtual_link
    if link is not None:
        text += f"; a tool with a goal gives way at up to {link.speed:g} m/s, {link.longest:g} m"
    return Finding(
        "news of obstacles",
        Severity.OK,
        text,
        {"self_motion": rate, "reach": 0.0 if standing == "stand" else reach},
    )
