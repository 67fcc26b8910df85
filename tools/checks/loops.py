"""Checks of the loops' stability: sources, tasks of several arms, force reflection."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...config.load import Cell, grasp_part
from ...config.schema.joint_task import JointTaskSection
from ...config.schema.network import ReflectionSection
from ...config.schema.section import Vector6
from ...protocols.topics import KEEPALIVE
from ...server.control.arm import Arm
from ...server.control.grasps import mean_of
from ...server.control.joint_task.forces import Moving, weight_of
from ...server.control.joint_task.joint_task import FIT_M, JointTask
from ...server.control.joint_task.load_shares import load_shares
from ...server.control.spatial import Array, Pose, rotate_twist
from ...server.reflection import ARM_S, FILTER_PER_GAIN, GREATEST, HeldStick, pose_stiffness
from ...server.stability.judgement import PayloadBounds, error_delay_periods, payload_words
from ...server.stability.loads import SharedLoad
from ...server.stability.loops import ForceLoop, bound
from .drives import ROOM, payloads, reading_finding
from .findings import Finding, Severity, Value, graded

# --- Check of the gains against the stiffest environment, with the loop's delay -------------------
COMFORT = 0.5  # part of the bound above which contact overshoots noticeably [1]
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


# --- Check of force reflection over the expected network: stability and timeouts ------------------
PER_HAND = 0.75
"""Reflected stiffness that settles at every delay to 0.5 s, as a part of the hand's own [1].

Measured on `pa10_reflect` (`tests/campaign/contact/reflection_trial.py`), with 20 % jitter and 5 %
loss: hands of 100, 200 and 400 N/m settle at this part of theirs and below it (the campaign's part
`reflection` shows the second); at the whole of it the second and third do not at every delay.
"""
STIFFEST = 300.0  # stiffest reflection that was measured to settle [N/m]
LOST = 3  # messages in a row that may be lost before a timeout [1]


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


# --- Check of tasks that several mechanisms hold: grasps, load, and force control at each grasp ---
SLOW = 0.05
"""A payload that a fault's force leaves less than this part of the tool's speed is worth a word
[1]."""

DIRECTIONS = tuple(f"{sign}{axis}" for axis in "xyz" for sign in "+-")


def joint_tasks(cell: Cell) -> Iterator[Finding]:
    """Judge every joint task of a cell; none in a cell without any."""
    arms = [Arm.of(part) for part in cell.parts] if cell.joint_tasks else []
    for section in cell.joint_tasks:
        task = JointTask(cell, section, arms)
        start = [np.array(cell.parts[i].config.mechanism.postures["start"]) for i in task.members]
        off = task.grips.misfit(start)
        otherwise = Severity.ERROR if section.at_start else Severity.WARN
        yield Finding(
            f"{section.name}.grasps",
            Severity.OK if off <= FIT_M else otherwise,
            f"{1e3 * off:.2g} mm from fitting each other at start, at most {1e3 * FIT_M:g} mm",
            {"misfit_m": off, "bound_m": FIT_M},
        )
        yield from _load(cell, section)
        yield _fault(cell, section, task, start)
        for i, name in enumerate(section.by):
            for finding in stability(grasp_part(cell, section, i)):
                if finding.check.startswith("force"):
                    yield replace(finding, check=f"{section.name}.{name}.{finding.check}")


def _fault(cell: Cell, section: JointTaskSection, task: JointTask, start: list[Array]) -> Finding:
    """Judge the force that a fault leaves at the posture `start`, and the speeds that it allows."""
    speed, bound = cell.config.limits.speed, section.most_internal_at_fault
    allowed, standing = {}, (0.0, "")
    for k, direction in enumerate(DIRECTIONS):
        twist = np.zeros(6)
        twist[k // 2] = speed if direction[0] == "+" else -speed
        moving, R_world_mrf = _moving(section, task, start, twist)
        allowed[direction] = speed * task.at_fault.slowed(moving, R_world_mrf).share
        standing = task.at_fault.standing(moving, R_world_mrf)
    slowest = min(allowed, key=lambda direction: allowed[direction])
    force, by = standing
    text = ", ".join(f"{direction} {v:.2g}" for direction, v in allowed.items())
    text = f"a fault at rest leaves {force:.2g} N ({by}), at most {bound:g} N; [m/s] {text}"
    slow = Severity.WARN if allowed[slowest] < SLOW * speed else Severity.OK
    return Finding(
        f"{section.name}.fault",
        Severity.ERROR if force > bound else slow,
        text,
        {"standing_n": force, "bound_n": bound, "slowest_m_s": allowed[slowest], "along": slowest},
    )


def _moving(
    section: JointTaskSection, task: JointTask, start: list[Array], twist: Array
) -> tuple[list[Moving], Array]:
    """Return arms at postures that move the payload by a twist (6,), and how it is turned."""
    views = [Pose.from_xyz_rpy(T.xyz, T.rpy) for T in section.T_wrist_mrf]
    tools = [arm.p.T_wrist_tool for arm in task.arms]
    wrists = [arm.mechanism.pose_wrist(q) for arm, q in zip(task.arms, start, strict=True)]
    R = mean_of([T @ view for T, view in zip(wrists, views, strict=True)]).R
    p = np.array([(view.inverse() @ tool).p for view, tool in zip(views, tools, strict=True)])
    payload = section.payload
    moment = payload.mass * np.array(payload.com)
    weight = weight_of(payload.mass, moment, Pose.identity(), R)
    shares = load_shares(p, np.array(section.shares), weight)
    found = []
    for arm, q, view, at, share in zip(task.arms, start, views, p, shares, strict=True):
        J = arm.mechanism.kinematics(q, view).J
        dq: Array = np.linalg.pinv(J, rcond=1e-6) @ twist
        found.append(Moving(q, dq, J, R @ at, rotate_twist(R, share)))
    return found, R


def _load(cell: Cell, section: JointTaskSection) -> Iterator[Finding]:
    """Judge what each arm bears of the payload: its weight, its joints' torques, its sensor."""
    by = {part.config.mechanism.name: part for part in cell.parts}
    parts = [by[name] for name in section.by]
    weights = np.array(section.shares)
    for part, load in zip(parts, SharedLoad(section, parts).borne(weights), strict=True):
        name, mechanism = f"{section.name}.{part.config.mechanism.name}", part.config.mechanism
        rated = mechanism.rated_payload
        if rated is not None:
            mass = load.payload.share * rated
            yield Finding(
                f"{name}.payload",
                Severity.OK if mass <= rated else Severity.ERROR,
                f"its share is {mass:.3g} kg, it is rated for {rated:g} kg",
                {"mass_kg": mass, "rated_kg": rated},
            )
        held = load.holding
        yield Finding(
            f"{name}.holding",
            graded(held.share, ROOM, 1.0),
            f"with its share {held.part} takes {held.share * held.most:.3g} of {held.most:g} "
            f"N·m {held.where}",
            {"share": held.share, "joint": held.part},
        )
        if mechanism.force_torque is not None:
            yield reading_finding(f"{name}.reading", load.reading, load.turned)
