"""Checks of a cell as a whole: arms, buses, network, timeouts, sensors."""

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...config.consistency import REQUIRED_POSTURES
from ...config.load import Cell, ConfigError
from ...config.schema.bus import BusSection, CanOpenNodeSection, Entry
from ...config.schema.mechanism import DriveSection
from ...config.schema.network import refuse_exposure
from ...config.schema.surroundings import MovingFrameSection
from ...drivers.network.certificates import known
from ...protocols.topics import JOYSTICK, KEEPALIVE
from ...server.control.mechanism.model import Mechanism
from ...server.control.proximity.capsules import Capsules
from ...server.control.proximity.pairs import PairSearch
from .findings import Finding, Severity, Value, graded

# --- Check of several arms: that they keep clear of each other, and do so in their postures -------
FARTHEST = 10.0  # arms that are farther apart count as this far [m]


def arms(cell: Cell) -> Iterator[Finding]:
    """Judge the distance between arms where all of them are at `start`, and at `ready`."""
    if len(cell.parts) < 2:
        return
    avoidance = cell.config.avoidance
    if not avoidance.enabled:
        text = "avoidance.enabled is false: nothing keeps the arms clear of each other at start"
        yield Finding("arms apart", Severity.WARN, text, {"enabled": False})
    capsules = Capsules(cell)
    for name in REQUIRED_POSTURES:
        gap, pair = nearest(cell, capsules, name, FARTHEST, of_arms=True)
        gap, pair = (gap, pair) if gap < FARTHEST else (FARTHEST, ())
        least = avoidance.self_clearance
        status, room = Severity.OK, least + avoidance.margin
        if gap < least:
            status = Severity.ERROR if name == "start" else Severity.WARN
        elif gap < room:
            status = Severity.WARN
        where = f"{pair[0]} and {pair[1]}" if pair else "all"
        far = f"at least {gap:.3g}" if gap == FARTHEST else f"{gap:.3g}"
        yield Finding(
            f"arms at {name}",
            status,
            f"{where} are {far} m apart; {least:g} m are promised, with a margin {room:g} m",
            {"gap": gap, "clearance": least, "margin": avoidance.margin},
        )


def nearest(
    cell: Cell, capsules: Capsules, posture: str, farthest: float, *, of_arms: bool = False
) -> tuple[float, tuple[str, ...]]:
    """Return the least distance of two links at a posture [m], or of two arms', and which links.

    The `farthest` distance, and none, where no two are nearer.
    """
    q = np.concatenate([part.config.mechanism.postures[posture] for part in cell.parts])
    room = np.full(len(capsules.radius), farthest)
    near = PairSearch(cell, capsules).find(capsules.place(q[None]), None, room, 0.0)
    links, arm = capsules.links, [link.partition(".")[0] for link in capsules.links]
    pairs = [
        (float(gap), (links[a], links[b]))
        for a, b, gap in zip(near.first, near.second, near.gap, strict=True)
        if not of_arms or arm[a] != arm[b]
    ]
    return min(pairs, key=lambda pair: pair[0], default=(farthest, ()))


# --- Check of each CAN bus's load, with every frame stuffed ---------------------------------------
LIMIT = 0.80  # above this load a classic CAN bus has no room left for SDO, EMCY and repetitions [1]
NOTICE = 0.60
HEARTBEAT_BYTES = 1


def worst_case_bits(data_bytes: int) -> int:
    """Return the bits of a standard frame with the most stuff bits, and the space after it.

    47 + 8n + ⌊(34 + 8n − 1) / 4⌋ (Davis, Burns, Bril, Lukkien 2007, eq. 1).
    """
    return 47 + 8 * data_bytes + (34 + 8 * data_bytes - 1) // 4


def bus_load(cell: Cell) -> Iterator[Finding]:
    """Judge the cyclic traffic of each bus against its bit rate."""
    for bus in cell.config.fieldbuses:
        on_it = [entry for entry in cell.devices if entry.bus == bus.name]
        yield from _load(cell, bus, on_it)
        told = ((entry.name, entry.section.about()) for entry in on_it)
        yield from (Finding(name, Severity.OK, text) for name, text in told if text)


def _load(cell: Cell, bus: BusSection, devices: list[Entry]) -> Iterator[Finding]:
    timing, bitrate = cell.config.timing, bus.bitrate
    burst, free = worst_case_bits(0), {}
    for entry in devices:
        arm = cell.parts[entry.part or 0].config.mechanism
        drive = entry.section if isinstance(entry.section, DriveSection) else None
        frames = entry.section.frames(arm.mode_of(drive) if drive else arm.operation_mode)
        bits = [(f.rate_hz, f.count * worst_case_bits(f.data_bytes)) for f in frames]
        burst += sum(b for rate, b in bits if rate is None)
        paced = sum(rate * b for rate, b in bits if rate is not None)
        if paced:
            free[entry.name] = paced / bitrate
    nodes = 1 + sum(isinstance(entry.section, CanOpenNodeSection) for entry in devices)
    heartbeats = nodes * worst_case_bits(HEARTBEAT_BYTES) / timing.heartbeat_period_s / bitrate
    cyclic = burst / timing.period_s / bitrate
    load = cyclic + sum(free.values()) + heartbeats
    shares = [f"{name} {share:.1%}" for name, share in free.items()]
    yield Finding(
        f"{bus.label} load",
        graded(load, NOTICE, LIMIT),
        f"{load:.1%} of {bitrate} bit/s, at most {LIMIT:.0%}: "
        + ", ".join([f"PDOs and SYNC {cyclic:.1%}", *shares, f"heartbeats {heartbeats:.1%}"]),
        {"load": load, "limit": LIMIT, "cyclic": cyclic, **free, "heartbeats": heartbeats},
    )
    n = sum(isinstance(entry.section, DriveSection) for entry in devices)
    burst_s = burst / bitrate
    yield Finding(
        f"{bus.label} cycle",
        graded(burst_s, 0.5 * timing.period_s, timing.period_s),
        f"SYNC, {n} replies and {n} commands take {burst_s * 1e3:.2f} ms of a period of "
        f"{timing.period_s * 1e3:g} ms",
        {"burst_s": burst_s, "period_s": timing.period_s},
    )


# --- Check of access to the daemon: roles and validity of certificates ----------------------------
def network(cell: Cell) -> Iterator[Finding]:
    """Judge whether strangers can reach the daemon, and how long the certificates hold."""
    zenoh = cell.config.zenoh
    values: dict[str, str | int | float | bool | None] = {
        "endpoint": zenoh.endpoint,
        "exposed": zenoh.exposed,
    }
    try:
        refuse_exposure(cell.config.zenoh, cell.path)
    except ConfigError as error:
        yield Finding("network", Severity.ERROR, str(error), values)
        return
    if zenoh.exposed:
        text = f"{zenoh.endpoint}: insecure: anybody who reaches it may command"
        yield Finding("network", Severity.WARN, text, values)
    elif zenoh.security.directory is None:
        yield Finding("network", Severity.OK, f"{zenoh.endpoint}: this machine only", values)
    else:
        yield Finding("network", Severity.OK, f"{zenoh.endpoint}: with certificates only", values)
        yield from certificates(cell.path.parent / zenoh.security.directory)


def certificates(folder: Path) -> Iterator[Finding]:
    """Judge the certificates of a folder: how long they hold, and who may read the keys."""
    try:
        good, complaints = known(folder)
    except ConfigError as error:
        text = f"{error}; telerobot certify makes certificates"
        yield Finding("certificates", Severity.WARN, text, {"certificates": 0})
        return
    for complaint in complaints:
        yield Finding("certificates", Severity.WARN, complaint)
    if good and not complaints:
        first = min(good, key=lambda one: one.ends)
        days = (first.ends - datetime.now(UTC)).days
        text = f"{len(good)}, of which {first.name} expires first, on {first.ends:%Y-%m-%d}"
        yield Finding("certificates", Severity.OK, text, {"certificates": len(good), "days": days})
    for key in sorted(folder.glob("*.key")):
        mode = key.stat().st_mode & 0o777
        if mode & 0o077:
            text = f"{key}: others may read it (mode {mode:o}); chmod 600"
            yield Finding("private key", Severity.WARN, text, {"mode": mode})


# --- Check of sensor keys: greatest effect on the arm of news without a lease ---------------------
GRAVITY = 9.81  # [m/s²]


def sensors(cell: Cell) -> Iterator[Finding]:
    """Tell for each sensor key what its news can move, and how fast at most."""
    for name, frame in cell.config.frames.moving.items():
        yield _frame(cell, name, frame)
    if cell.cameras:
        vision = cell.config.sources.vision
        until = "the source is on" if vision.view else "a view is stored and the source is on"
        yield Finding(
            "pictures",
            Severity.OK,
            f"move nothing until {until}; then the tool at up to {vision.speed:g} m/s, "
            f"{vision.angular_speed:g} rad/s",
            {"speed": vision.speed},
        )
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
        when = "a tool" if link.always else "a tool with a goal"
        text += f"; {when} gives way at up to {link.speed:g} m/s, {link.longest:g} m"
    return Finding(
        "news of obstacles",
        Severity.OK,
        text,
        {"self_motion": rate, "reach": 0.0 if standing == "stand" else reach},
    )


# --- Check of periods and timeouts: their order makes silence safe --------------------------------
FRESH = 2.0  # a timeout spans at least this many of the periods that it watches


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
