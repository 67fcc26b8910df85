"""Checks of drives: bounds, resolution, enabling, load, torque, and how they follow."""

import math
from collections.abc import Iterator

import numpy as np

from ...config.load import Cell
from ...config.schema.mechanism import DifferentialBaseSection, DriveSection, PayloadSection
from ...config.urdf.robot import UrdfJoint
from ...drivers.canopen.servo_setup import SAG, Setpoint
from ...drivers.device import MOST_MISSED_SYNCS, SWITCH_OFF_S
from ...protocols.canopen.cia402 import HALF, SPAN, OperationMode
from ...server.control.forest import standing_on
from ...server.control.mechanism.model import Mechanism
from ...server.stability.judgement import PayloadBounds, payload_words
from ...server.stability.loads import (
    Used,
    dynamics_of,
    most_torques,
    reading,
    sensor_up,
    weight_map,
)
from ...server.stability.loops import RATIOS, ForceLoop, delays, spectral_radius, stiffest_hand
from .findings import Finding, Severity, graded

# --- Check of the drives' bounds against the robot's, and of their resolution ---------------------
QUANTISATION_NOTICE = 0.25
"""Part of the jerk bound that the encoder's steps may look like before it is worth a word [1]."""
TORQUE_PER_MILLE_MAX = 32767  # greatest value of 6077h, in thousandths of the rated torque [1]
LONG_STOP_S = 0.5  # a stop from full speed that takes longer is worth a word [s]
ENDLESS_STOP_S = 2.0  # one that takes longer than this is none [s]


def drives(cell: Cell) -> Iterator[Finding]:
    """Judge every drive against its joint in the URDF, against its encoder and its own ramp."""
    mechanism, period_s = cell.config.mechanism, cell.config.timing.period_s
    weight = np.abs(Mechanism.from_cell(cell).gravity(np.array(mechanism.postures["ready"]))[0])
    for joint, drive, held in zip(cell.robot.joints, mechanism.drives, weight, strict=True):
        yield Finding(
            f"{joint.name} speed",
            graded(drive.max_velocity, joint.velocity, joint.velocity),
            f"{drive.max_velocity:g} rad/s, URDF {joint.velocity:g}",
            {"max_velocity": drive.max_velocity, "urdf": joint.velocity},
        )
        yield _torque(drive, joint, float(held))
        apparent = 4.0 / (drive.counts_per_radian * period_s**3)
        share = apparent / drive.max_jerk
        yield Finding(
            f"{drive.joint} encoder",
            graded(share, QUANTISATION_NOTICE, 1.0),
            f"4 steps / T³ look like a jerk of {apparent:.3g} rad/s³, {share:.1%} of the bound "
            f"{drive.max_jerk:g}",
            {"apparent_jerk": apparent, "max_jerk": drive.max_jerk},
        )
        yield _stop(drive)
        if joint.name in mechanism.wheels and mechanism.base is not None:
            yield _wraps(drive, mechanism.base, period_s)


def _torque(drive: DriveSection, joint: UrdfJoint, weight: float) -> Finding:
    per_mille = 1000.0 * drive.max_torque / drive.rated_torque
    status = graded(drive.max_torque, joint.effort, joint.effort)
    text = f"{drive.max_torque:g} N·m, URDF {joint.effort:g}"
    if status is Severity.ERROR and joint.effort < weight:
        status = Severity.WARN
        text += f", which would not hold the {weight:.3g} N·m of `ready`"
    if per_mille > TORQUE_PER_MILLE_MAX:
        status = Severity.ERROR
        text += f"; {per_mille:.0f} thousandths of the rated torque do not fit into 6077h"
    return Finding(
        f"{joint.name} torque",
        status,
        text,
        {"max_torque": drive.max_torque, "urdf": joint.effort, "per_mille": per_mille},
    )


def _stop(drive: DriveSection) -> Finding:
    """Judge how long a stop from full speed takes: on the drive's own ramp, and verified."""
    V, A, J = drive.max_velocity, drive.max_acceleration, drive.max_jerk
    ramp_s = V / drive.quick_stop_deceleration
    verified_s = V / A + A / J if V * J > A**2 else 2.0 * math.sqrt(V / J)
    longest_s = max(ramp_s, verified_s)
    text = (
        f"quick stop {ramp_s:.3g} s at {drive.quick_stop_deceleration:g} rad/s², "
        f"verified stop {verified_s:.3g} s"
    )
    status = graded(longest_s, LONG_STOP_S, ENDLESS_STOP_S)
    if longest_s > LONG_STOP_S:
        text += f": a stop from {V:g} rad/s may take at most {ENDLESS_STOP_S:g} s"
    elif drive.quick_stop_deceleration < A:
        status = Severity.WARN
        text += ": the ramp takes longer than the bound A would"
    return Finding(
        f"{drive.joint} stops",
        status,
        text,
        {
            "quick_stop_deceleration": drive.quick_stop_deceleration,
            "max_acceleration": A,
            "quick_stop_s": ramp_s,
            "verified_stop_s": verified_s,
        },
    )


def _wraps(drive: DriveSection, base: DifferentialBaseSection, period_s: float) -> Finding:
    """Judge the counts of a wheel, which wrap: between two answers it goes the shorter way.

    A drive may miss some SYNCs before it is lost.
    """
    turned = drive.max_velocity * (MOST_MISSED_SYNCS + 1) * period_s
    counts = turned * drive.counts_per_radian
    around = base.wheels.radius * SPAN / drive.counts_per_radian
    fastest = drive.max_velocity * drive.counts_per_radian
    share = max(counts, fastest) / HALF
    return Finding(
        f"{drive.joint} counts",
        graded(share, 0.5, 1.0),
        f"wrap after {around:.4g} m; {fastest:.3g} counts/s at full speed, at most {HALF - 1} fit "
        "into 60FFh",
        {"wrap_m": around, "counts_per_second": fastest, "most": HALF - 1},
    )


# --- Check of enabling where the joints stand, and of the drives' timeouts ------------------------
def enabling(cell: Cell) -> Iterator[Finding]:
    """Judge the room of drives for a joint at its limit, and how long they take to let go."""
    drives = cell.config.mechanism.drives
    for joint, drive in zip(cell.robot.joints, drives, strict=True):
        if joint.name in cell.config.mechanism.wheels:
            continue  # they have no limits
        setpoint = Setpoint(drive, OperationMode.CSP)
        for angle in (joint.lower - drive.window, joint.upper + drive.window):
            try:
                setpoint.raw(angle)
            except ValueError as error:
                yield Finding(
                    f"{joint.name} room",
                    Severity.ERROR,
                    f"607Dh cannot reach a following window beyond the limit: {error}",
                    {"angle": angle, "counts_per_radian": drive.counts_per_radian},
                )
    tightest = min(drives, key=lambda d: d.position_margin)
    margin, inside = tightest.position_margin, tightest.position_margin >= SAG
    judgement = "still inside its limit" if inside else "outside its limit, and only comes in"
    yield Finding(
        "enabling at a limit",
        Severity.OK if inside else Severity.WARN,
        f"position_margin of {tightest.joint} is {margin:g} rad: a joint that sags by {SAG:g} rad "
        f"when it is enabled is {judgement}",
        {"joint": tightest.joint, "position_margin": margin, "sag": SAG},
    )
    slowest = max(drives, key=lambda d: d.max_velocity / d.quick_stop_deceleration)
    ramp_s = slowest.max_velocity / slowest.quick_stop_deceleration
    yield Finding(
        "switching off",
        Severity.OK if ramp_s < SWITCH_OFF_S else Severity.ERROR,
        f"{slowest.joint} takes {ramp_s:.2f} s to ramp down from full speed; a drive that is on "
        f"{SWITCH_OFF_S:.2f} s after it was told to switch off is a fault",
        {"joint": slowest.joint, "ramp_s": ramp_s, "patience_s": SWITCH_OFF_S},
    )


# --- What holds an arm and its load still, against what its motors and its sensor are made for ----
ROOM = 0.5
"""Part of a motor's torque, or a sensor's range, that holding still may take before it is worth a
word [1]."""


def carried(cell: Cell) -> Iterator[Finding]:
    """Judge what holds the joints of each torso under all that stands on it, arms at `ready`."""
    for i in sorted(set(cell.carriers) - {-1}):
        torso, mass, moment = cell.parts[i], 0.0, np.zeros(3)
        for part, under in zip(cell.parts, cell.carriers, strict=True):
            if under == i:
                ready, T_on = np.array(part.config.mechanism.postures["ready"]), standing_on(part)
                own, centre = Mechanism.from_cell(part).mass(ready)
                mass, moment = mass + own, moment + own * (T_on.R @ centre + T_on.p)
        dynamics, most = dynamics_of(torso), most_torques(torso)
        dynamics.carry(mass, moment / max(mass, 1e-9))
        joints = torso.config.mechanism.drives
        for name, posture in torso.config.mechanism.postures.items():
            share = np.abs(dynamics.bias(np.array(posture), np.zeros(len(joints)))) / most
            j = int(np.argmax(share))
            taken = float(share[j])
            yield Finding(
                f"{torso.prefix}carrying {name}",
                graded(taken, ROOM, 1.0),
                f"{joints[j].joint} takes {taken * most[j]:.3g} of {most[j]:g} N·m under the "
                f"{mass:.3g} kg that stand on it",
                {"share": taken, "joint": joints[j].joint, "mass_kg": mass},
            )


def holding(cell: Cell) -> Iterator[Finding]:
    """Judge each posture of the cell under the heaviest of its payloads, by the URDF's masses.

    And what the sensor reads of each payload, there and at any other attitude.
    """
    section, dynamics = cell.config.mechanism, dynamics_of(cell)
    joints, sensor = Mechanism.from_cell(cell).joints, section.force_torque
    payloads: dict[str, PayloadSection | None] = {"the URDF's tool": None}
    if sensor is not None:
        payloads |= {"its payload": sensor.payload} if sensor.payload.mass else {}
        payloads |= {f"payload {name}": p for name, p in section.payloads.items()}
    most = most_torques(cell)
    worst: dict[str, tuple[float, int, str]] = {}
    for load, payload in payloads.items():
        if payload is not None:
            dynamics.carry(payload.mass, np.array(payload.com))
        for name, posture in section.postures.items():
            share = np.abs(dynamics.bias(np.array(posture), np.zeros(len(joints)))) / most
            j = int(np.argmax(share))
            worst[name] = max(worst.get(name, (0.0, 0, load)), (float(share[j]), j, load))
    for name, (taken, j, load) in worst.items():
        yield Finding(
            f"holding {name}",
            graded(taken, ROOM, 1.0),
            f"{joints[j]} takes {taken * most[j]:.3g} of {most[j]:g} N·m with {load}",
            {"share": taken, "joint": joints[j]},
        )
    if sensor is not None:
        at = {name: sensor_up(cell, np.array(q)) for name, q in section.postures.items()}
        found = [
            reading_finding(
                f"reading with {load}",
                reading(sensor, weight_map(payload), at),
                reading(sensor, weight_map(payload), {}),
            )
            for load, payload in payloads.items()
            if payload is not None
        ]
        # The heaviest reading stands for all that are well.
        found.sort(key=lambda f: float(f.values["share"] or 0.0), reverse=True)
        yield from (f for i, f in enumerate(found) if i == 0 or f.status is not Severity.OK)


def contact(cell: Cell) -> Iterator[Finding]:
    """Tell from which torques on joints feel contact, and warn where they feel none."""
    section, most = cell.config.touch, float(most_torques(cell).max())
    if section is None:
        text = f"without [touch] no joint feels what links press, with up to {most:g} N·m"
        yield Finding("contact", Severity.WARN, text, {"torque": most})
    else:
        least, most = min(section.torque), max(section.torque)
        text = f"felt from {least:g} to {most:g} N·m (N) on, given way by {section.leash:g} rad"
        yield Finding("contact", Severity.OK, text, {"torque": least})


def reading_finding(check: str, found: Used, turned: Used) -> Finding:
    """Judge what a sensor reads of a load against its measuring range.

    At the postures that the cell has, and `turned` to whichever attitude it takes most.
    """
    status = graded(found.share, ROOM, 1.0)
    if turned.share > 1.0 and status is not Severity.ERROR:
        status, found = Severity.WARN, turned
    return Finding(
        check,
        status,
        f"{found.part} reads {found.share * found.most:.3g} of {found.most:.4g} {found.unit} "
        f"{found.where}",
        {"share": found.share, "axis": found.part, "range": found.most},
    )


# --- Check of following a hand: the arm's delay, and the stiffest hand that it bears --------------
COMFORT = 0.5  # part of the bound above which a hand feels the arm swing [1]


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


# --- Stability of the torque law of drives in CST -------------------------------------------------
SWIFT = 0.98  # magnitude of a pole above which errors linger [1]


def torque(cell: Cell) -> Iterator[Finding]:
    """Judge the law of a cell in CST; nothing in the other modes."""
    if cell.config.mechanism.operation_mode != "cst":
        return
    gains, period = cell.config.torque, cell.config.timing.period_s
    radii = {ratio: spectral_radius(gains, period, ratio) for ratio in RATIOS}
    worst = max(radii.values())
    yield Finding(
        "torque law",
        graded(worst, SWIFT, 1.0),
        "greatest pole "
        + ", ".join(f"{r:.3f} at {ratio:g} × the modelled inertia" for ratio, r in radii.items())
        + f", stable below 1; tool lags its command by {gains.lag_s * 1e3:g} ms as stated",
        {"radius": worst, "lag_s": gains.lag_s},
    )
