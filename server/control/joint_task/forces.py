"""Forces at the grasps of one payload: wanted, measured, weighed, and bounded at a fault."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ....config.schema.joint_task import JointTaskSection
from ..arm import Arm
from ..compiled import MATRIX, NUMBER, ROW, VECTOR, compiled, evolve, inner_kernel
from ..grasps import FOLLOW_TIME_S, TOLD, GraspState, Weighed, apart, follow, mean_of
from ..hold import beyond
from ..inputs import Inputs, Intent, Pushed
from ..mechanism.model import Dynamics
from ..mechanism.wrench import WristMemory
from ..scene import Flags
from ..spatial import (
    GRAVITY,
    Array,
    Kinematics,
    Pose,
    cross,
    jacobian_at,
    rotate_twist,
    rotation_log,
    sizes,
    skew,
    twist_at,
    wrench_to,
)
from ..state import ArmMemory
from ..task.following import STAYS_S
from ..task.sources import ForceState, bleed, desired_wrench
from .load_shares import greatest, internal, load_shares, total

# --- Speed of a payload, bounded by the internal force that a fault would leave -------------------
#
# When a drive fails, an arm's brakes fall in or a bus goes silent, one joint or one arm comes
# to rest otherwise than the rest, which is told some periods later and then takes its time on
# its ramps. By how much the grasps end apart, times the stiffness of the pads, is the force.
# Arms are taken as rigid: what drives and links yield makes it less. What is looked at, with T
# the period and r the mean time that the ramps take, R/2 of the slowest joint in proportion to
# the speed:
#
# - an arm stands at once, the others go on for T + r: its brakes hold at once, or its bus is
#   unplugged, which is told after one SYNC that it does not answer;
# - a drive is silent and stands, all others go on until it is told, `AWAITED` SYNCs later, and r;
# - a joint or an arm without power goes on, and falls, until brakes hold and have stopped it, while
#   the others are told within T of it, and stop on their ramps.

AWAITED = 4
"""A drive's silence is told with this SYNC that it does not answer [1]."""

STANDING_PART = 0.1
"""Where a fault at rest leaves more than the bound, speed may add this part of it: there slowing
down helps no further [1]."""

_GRID = 8
"""A slower motion may be worse where brakes and ramps meet: so many shares are tried [1]."""
_HALVINGS = 7
_WEAK = 1e-3
"""A brake decelerates by at least this [rad/s²]; weaker ones do not hold."""


class Slowed(NamedTuple):
    """How far a payload is to be slowed down for what a fault would do."""

    share: float
    """Of the motion asked for, 0 to 1."""
    by: str
    """Name of the joint or arm whose fault would press most; "" for none."""


class Moving(NamedTuple):
    """One arm that moves the payload."""

    q: Array
    """(n,) [rad]."""
    dq: Array
    """Joint rates that are asked for (n,) [rad/s]."""
    J: Array
    """Jacobian (6, n) at the MRF, World axes."""
    grasp: Array
    """Lever from the MRF to its grasp (3,) [m], World axes."""
    carried: Array
    """Its share of the wrench on the payload (6,), at the grasp, World axes."""


class AtFault:
    """The bound of one joint task."""

    def __init__(
        self, section: JointTaskSection, arms: Sequence[Arm], nominal: Sequence[Pose]
    ) -> None:
        """Build it for the arms that hold the payload; `nominal` are T_wrist_mrf at start."""
        self._arms = tuple(arms)
        self._T = arms[0].p.period_s
        grasps = [T.inverse() @ arm.p.T_wrist_tool for T, arm in zip(nominal, arms, strict=True)]
        wrenches = pads(
            np.array([grasp.p for grasp in grasps]),
            section.internal_stiffness,
            section.internal_stiffness_rotation,
        )
        own = [slice(6 * i, 6 * i + 6) for i in range(len(arms))]
        forces = wrenches.reshape(len(arms), 6, -1)[:, :3].reshape(3 * len(arms), -1)
        self._forces = [forces[:, part].copy() for part in own]
        self._stiffness = [wrenches[part, part].copy() for part in own]
        self._bound = section.most_internal_at_fault
        self._falls = [_dynamics(arm) for arm in arms]
        self._drives = [
            np.array([p.quick_stop_deceleration, p.coasting_s, p.brake_closes_s, p.brake_torque])
            for p in (arm.p for arm in arms)
        ]

    def slowed(self, moving: Sequence[Moving], R_world_payload: Array) -> Slowed:
        """Return the share of the motion at which no fault presses more than the bound."""
        ramp_s = max(
            float((np.abs(arm.dq) / drives[0]).max())
            for arm, drives in zip(moving, self._drives, strict=True)
        )
        if ramp_s <= 0.0:
            return Slowed(1.0, "")
        share, by = 1.0, ""
        bends = self._bends(moving, 0.5 * ramp_s, R_world_payload)
        bounds = self._bound, bends
        for i in range(len(moving)):
            Q, fall = self._one(i, moving[i], R_world_payload)
            drives, worst = self._drives[i], np.empty(2)
            own = _slowed(Q, moving[i].dq, fall, drives, self._T, ramp_s, *bounds, worst)
            if own < share:
                share, joint = own, int(worst[0])
                names = self._arms[i].p.joints.names
                by = names[joint] if joint >= 0 else names[0].partition(".")[0]
        return Slowed(share, by)

    def standing(self, moving: Sequence[Moving], R_world_payload: Array) -> tuple[float, str]:
        """Return the greatest force of a fault while the arms stand [N], and whose it is."""
        most, by = 0.0, ""
        for i, arm in enumerate(moving):
            Q, fall = self._one(i, arm, R_world_payload)
            worst, still = np.empty(2), np.zeros(len(arm.dq))
            _worst(Q, still, fall, self._drives[i], self._T, 0.0, worst)
            if worst[1] > most:
                names, joint = self._arms[i].p.joints.names, int(worst[0])
                by = names[joint] if joint >= 0 else names[0].partition(".")[0]
                most = float(worst[1])
        return most, by

    def _bends(self, moving: Sequence[Moving], mean_s: float, R_world_payload: Array) -> float:
        """Return the force [N] of a stop of all arms by which none fails, along their joints."""
        forces = np.zeros(len(self._forces[0]))
        for i, (arm, own) in enumerate(zip(self._arms, moving, strict=True)):
            T = arm.mechanism.pose_wrist(own.q) @ arm.p.T_wrist_tool
            rest = arm.mechanism.pose_wrist(own.q + mean_s * own.dq) @ arm.p.T_wrist_tool
            forces += self._forces[i][:, :3] @ (R_world_payload.T @ (rest.p - T.p))
            turned = rotation_log(rest.R @ T.R.T)
            forces += self._forces[i][:, 3:] @ (R_world_payload.T @ turned)
        return float(np.linalg.norm(forces.reshape(-1, 3), axis=1).max())

    def _one(self, i: int, arm: Moving, R_world_payload: Array) -> tuple[Array, Array]:
        """Return the forces at all grasps (3k, n) by what one arm's joints move, and how they fall.

        That is the torque (n,) that lets go with the power, the inertia that it moves, and the
        stiffness of the payload against it (3, n).
        """
        J = jacobian_at(arm.J, arm.grasp)
        turned = np.concatenate([R_world_payload.T @ J[:3], R_world_payload.T @ J[3:]])
        weight, inertia = self._falls[i].standing(arm.q)
        against = (turned * (self._stiffness[i] @ turned)).sum(axis=0)
        fall = np.array([weight + J.T @ arm.carried, inertia, against])
        return self._forces[i] @ turned, fall


def pads(p: Array, stiffness: float, turning: float) -> Array:
    """Return the wrenches (6k, 6k) of k pads by how their flanges are displaced, payload's axes.

    The payload is rigid and goes where the pads' wrenches cancel; pads at p (k, 3) [m] of the
    payload have `stiffness` [N/m] and `turning` [N·m/rad].
    """
    k = len(p)
    K = np.diag(([stiffness] * 3 + [turning] * 3) * k)
    G = np.zeros((6, 6 * k))
    for i, at in enumerate(p):
        G[:, 6 * i : 6 * i + 6] = np.eye(6)
        G[3:, 6 * i : 6 * i + 3] = skew(at)
    held: Array = K - K @ G.T @ np.linalg.solve(G @ K @ G.T, G @ K)
    return held


def _dynamics(arm: Arm) -> Dynamics:
    """Return how an arm falls with its own tool."""
    p = arm.p
    dynamics = Dynamics(arm.mechanism, p.rotor_inertia, p.T_wrist_sensor)
    if p.T_wrist_sensor is not None:
        dynamics.carry(p.payload.mass, p.payload.com)
    return dynamics


@inner_kernel
def _greatest(Q: Array, x: Array) -> float:
    """Return the greatest force [N] at a grasp by displacements x (n,) of joints, Q (3k, n)."""
    most = 0.0
    for i in range(0, len(Q), 3):
        square = 0.0
        for row in range(i, i + 3):
            force = 0.0
            for j in range(len(x)):
                force += Q[row, j] * x[j]
            square += force * force
        most = max(most, square)
    return math.sqrt(most)


@compiled(MATRIX, VECTOR, MATRIX, MATRIX, NUMBER, NUMBER, ROW)
def _worst(
    Q: Array, dq: Array, fall: Array, drives: Array, T: float, ramp_s: float, worst: Array
) -> None:
    """Fill in which fault of an arm presses most, and how much: joint (−1: all of them), force [N].

    At rates dq (n,) from which all joints come to rest on ramps of `ramp_s`. `fall` is torque that
    holds, inertia and stiffness (3, n), `drives` ramp [rad/s²], coasting [s], brake's time [s] and
    its torque (4, n).
    """
    n, mean_s = len(dq), 0.5 * ramp_s
    early, late = np.empty(n), np.empty(n)
    unit, x = np.empty(n), np.zeros(n)
    for j in range(n):
        x[j] = 1.0
        unit[j] = _greatest(Q, x)
        x[j] = 0.0
    for j in range(n):
        torque, inertia, stiff = fall[0, j], max(fall[1, j], 1e-6), max(fall[2, j], 1e-6)
        closes_s, brake = drives[2, j], drives[3, j]
        # It swings down on the pads' spring until the brake closes, and slips until that holds it.
        hangs, turns = torque / stiff, math.sqrt(stiff / inertia)
        phase = min(turns * closes_s, math.pi)
        fallen = -hangs * (1.0 - math.cos(phase))
        v = dq[j] - hangs * turns * math.sin(phase)
        load = -torque - stiff * fallen
        holds = max((brake - max(load if v > 0.0 else -load, 0.0)) / inertia, _WEAK)
        alone = dq[j] * closes_s + 0.5 * dq[j] * abs(dq[j]) * inertia / max(brake, _WEAK)
        goes = dq[j] * closes_s + fallen + 0.5 * v * abs(v) / holds
        most_fall = 2.0 * abs(hangs)
        goes = alone + min(max(goes - alone, -most_fall), most_fall)
        early[j] = goes - dq[j] * mean_s
        late[j] = goes - dq[j] * (T + mean_s)
        x[j] = (T + mean_s) * dq[j]
    joint, most = -1, max(_greatest(Q, x), _greatest(Q, early), _greatest(Q, late))
    for j in range(n):
        silent = abs(dq[j]) * max(AWAITED * T - drives[1, j] + mean_s, 0.0)
        force = unit[j] * max(silent, abs(early[j]), abs(late[j]))
        if force > most:
            joint, most = j, force
    worst[0], worst[1] = joint, most


@compiled(MATRIX, VECTOR, MATRIX, MATRIX, NUMBER, NUMBER, NUMBER, NUMBER, ROW)
def _slowed(
    Q: Array,
    dq: Array,
    fall: Array,
    drives: Array,
    T: float,
    ramp_s: float,
    most: float,
    bends: float,
    worst: Array,
) -> float:
    """Return the share of rates dq (n,) up to which no fault of an arm presses by more than `most`.

    Arguments as of `_worst`, which tells what stands in the way; at the full rates a stop of all
    arms presses by `bends` [N] beside: a way at rest goes by the square of the speed, and bends
    away from a straight one by its own square.
    """
    rates = np.zeros(len(dq))
    _worst(Q, rates, fall, drives, T, 0.0, worst)
    most = max(most, worst[1] + STANDING_PART * most)
    low = 0.0
    for step in range(1, _GRID + 1):
        share = step / _GRID
        for j in range(len(dq)):
            rates[j] = share * dq[j]
        _worst(Q, rates, fall, drives, T, share * ramp_s, worst)
        if worst[1] + bends * share**4 > most:
            break
        low = share
    if low >= 1.0:
        return 1.0
    high = low + 1.0 / _GRID
    by, force = worst[0], worst[1]
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        for j in range(len(dq)):
            rates[j] = share * dq[j]
        _worst(Q, rates, fall, drives, T, share * ramp_s, worst)
        if worst[1] + bends * share**4 > most:
            high, by, force = share, worst[0], worst[1]
        else:
            low = share
    worst[0], worst[1] = by, force
    return low


# --- Weighing of a payload by its grasps: what nobody told of is held up, and not followed --------
#
# Force control gives way to whatever the grasps exert beyond their shares. A payload that
# weighs otherwise than it was told reads like contact that never ends: the arms would sink, or
# rise, for as long as one looks. Contact falls as the arms give way to it, weight does not. So
# the sum at the grasps is looked at over a while: what of its vertical force, or of its moment
# about the horizontal, stayed the same although the payload moved by what force control asked
# for, is weight. It counts as the payload's from then on, wherever that is turned, and the
# vertical accommodation rests. Before the first such judgement after the drives were switched
# on, force control gives way to a small part of the sum only, so that a payload told very wrong
# does not fall meanwhile.
#
# What is horizontal is no weight, but may be a hand, which holds no force for long, or a sensor
# whose zero is off. What led the payload by a step and stayed the same all the while is the
# latter: it counts as nothing from then on.

G = -float(GRAVITY[2])

WHILE_S, ASKED_S = 0.2, 1.0
"""The sum is compared over so long: while nothing else is asked of the arms, and while it is [s].

A peg that slides up a chamfer is pushed steadily, too, for as long as the chamfer lasts."""

STEADY = (0.1, 0.05)
"""Sums that differ by less are the same: noise of the sensors [N, N·m]."""

STIFFNESS = (500.0, 10.0)
"""And by less than this for each unit that the payload gave way: half of the softest contact
[N/m, N·m/rad]."""

GIVES_WAY = (1e-6, 1e-5)
"""Force control that asked for less over that time asked for nothing [m, rad]."""

WENT = 0.5
"""The payload went where force control asked if it did this part of it [1]."""

ASKED = np.array([1e-3] * 3 + [2e-3] * 3)
"""Nothing else is asked of the arms while their sources ask for less (6,) [m/s, rad/s]."""

PROBE = 5.0
"""Before the sum was judged once, no more of it than this is given way to [N]."""

PART = 5e-3
"""Sums that differ by less than this part of them are the same, too [1]."""

SMOOTH_S = 0.05
"""Time constant of the sum that is compared [s]."""

UNCHANGED = (0.5, 0.25)
"""Horizontal sums that differ by less are the same: sensors are half a metre apart [N, N·m]."""

STEP = (1e-3, 5e-3)
"""And are no contact's if the payload gave way to them by so much [m, rad]."""


class Told(NamedTuple):
    """Sum of the grasps and what the arms are asked for, in one tick."""

    contact: Array | None
    """Wrench (6,) beyond the payload's weight as it counts, at and in the MRF; None without all."""
    wanted: bool
    """An operator asks for a wrench: then what is beyond the weight is wanted."""
    T_payload_mrf: Pose
    T_world_mrf: Pose
    twist: Array
    """What the sources but force control ask for (6,), World axes."""
    way: Array
    """What force control asks for, as the mean of all arms (6,), World axes."""


def weight_of(mass: float, moment: Array, T_payload_mrf: Pose, R_world_mrf: Array) -> Array:
    """Return the wrench (6,) that holds a payload up, at and in the MRF.

    `moment` (3,) is its first moment of mass, about its own frame's origin and in its axes [kg·m].
    """
    up = R_world_mrf.T @ -GRAVITY
    at = T_payload_mrf.R.T @ (moment - mass * T_payload_mrf.p)
    return np.concatenate([mass * up, cross(at, up)])


def weighed(before: Weighed, told: Told, intent: Intent, period_s: float) -> Weighed:
    """Return what is known of the payload's weight one period later."""
    looks = intent in (Intent.MOVE, Intent.HOLD) and not told.wanted
    if told.contact is None or not looks:
        return before._replace(sum=None, time_s=0.0, felt=None)
    wrench = wrench_to(told.T_payload_mrf, told.contact)
    sum_now = _weight_in(wrench, told) + G * before.waits
    asked = bool((np.abs(told.twist) > ASKED).any())
    before = _led(before, wrench, told, asked, period_s)
    if asked and not before.judged:
        before = before._replace(judged=True, waits=np.zeros(4))
    if before.sum is None or asked != before.asked:
        way = np.zeros(4)
        return before._replace(
            sum=sum_now, mark=sum_now, began=told.T_world_mrf, asked=asked, way=way, time_s=0.0
        )
    smooth = before.sum + (1.0 - math.exp(-period_s / SMOOTH_S)) * (sum_now - before.sum)
    way, time_s, waits = (
        before.way + told.way[2:] * period_s,
        before.time_s + period_s,
        before.waits,
    )
    if not before.judged:
        beyond = float(smooth[0]) - min(PROBE, max(-PROBE, float(smooth[0])))
        waits = np.array([beyond / G, 0.0, 0.0, 0.0])
    now = before._replace(sum=smooth, way=way, time_s=time_s, waits=waits)
    if time_s < (ASKED_S if asked else WHILE_S):
        return now
    extra = _steady(now, told.T_world_mrf)
    judged = now.judged or bool(extra[0]) or abs(float(smooth[0])) < PROBE
    return now._replace(
        load=now.load + extra / G,
        judged=judged,
        waits=np.zeros(4) if judged else now.waits,
        sum=smooth - extra,
        mark=smooth - extra,
        began=told.T_world_mrf,
        way=np.zeros(4),
        time_s=0.0,
    )


def _led(before: Weighed, wrench: Array, told: Told, asked: bool, period_s: float) -> Weighed:
    """Return what is known of what leads the payload aside, one period later.

    `wrench` (6,) is the contact, at and in the payload's frame.
    """
    here = told.T_world_mrf @ told.T_payload_mrf.inverse()
    now, felt, began = rotate_twist(here.R, wrench)[[0, 1, 5]], before.felt, before.led_from
    x, y, about = (now - (now if felt is None else felt)).tolist()
    changed = math.hypot(x, y) > UNCHANGED[0] or abs(about) > UNCHANGED[1]
    if felt is None or began is None or asked or changed:
        return before._replace(felt=now, led_from=here, led_s=0.0)
    time_s = before.led_s + period_s
    felt = felt + period_s / time_s * (now - felt)
    force = max(math.hypot(felt[0], felt[1]), 1e-9)
    back = -float((here.p - began.p)[:2] @ felt[:2]) / force
    turned = -float(rotation_log(here.R @ began.R.T)[2]) * math.copysign(1.0, felt[2])
    # It went there because force control asked for it, not by what else moves the arms.
    back = min(back, math.hypot(told.way[0], told.way[1]) * time_s)
    turned = min(turned, abs(float(told.way[5])) * time_s)
    if time_s < STAYS_S or (back < STEP[0] and turned < STEP[1]):
        return before._replace(felt=felt, led_s=time_s)
    return before._replace(aside=before.aside + felt, felt=None, led_from=None, led_s=0.0)


def led_by(aside: Array, T_payload_mrf: Pose, R_world_mrf: Array) -> Array:
    """Return the wrench (6,) at and in the MRF of what leads a payload aside (3,) [N, N·m]."""
    x, y, about = aside.tolist()
    R = T_payload_mrf.R @ R_world_mrf.T
    wrench = rotate_twist(R, np.array([x, y, 0.0, 0.0, 0.0, about]))
    return wrench_to(T_payload_mrf.inverse(), wrench)


def _weight_in(wrench: Array, told: Told) -> Array:
    """Return the weight (4,) that a wrench would be: force [N], moment in the payload's axes [N·m].

    The moment is that of a force along the vertical: its point's place times the force. `wrench`
    (6,) is at and in the payload's frame.
    """
    up = told.T_payload_mrf.R @ told.T_world_mrf.R[2]
    return np.concatenate([[wrench[:3] @ up], cross(up, wrench[3:])])


def _steady(now: Weighed, T_world_mrf: Pose) -> Array:
    """Return which part (4,) of the sum stayed the same although the payload gave way to it."""
    extra = np.zeros(4)
    if now.sum is None or now.mark is None or now.began is None:
        return extra
    off, way = now.sum - now.mark, now.way
    went = float(T_world_mrf.p[2] - now.began.p[2])
    turned = rotation_log(T_world_mrf.R @ now.began.R.T)[:2]
    # What a stick holds against something stays the same, too: but the payload goes nowhere.
    fell, tilted = abs(float(way[0])), float(np.linalg.norm(way[1:3]))
    same = max(STEADY[0], PART * abs(float(now.sum[0])), STIFFNESS[0] * fell)
    if fell > GIVES_WAY[0] and went * way[0] >= WENT * fell**2 and abs(off[0]) <= same:
        extra[0] = now.sum[0]
    same = max(STEADY[1], STIFFNESS[1] * tilted)
    follows = float(turned @ way[1:3]) >= WENT * tilted**2
    if tilted > GIVES_WAY[1] and follows and np.linalg.norm(off[1:]) <= same:
        extra[1:] = now.sum[1:]
    return extra


# --- Forces at the grasps of one payload: what each arm is to exert, exerts, and gives way by -----
#
# Force control acts at each arm's *own grasp* and not at the shared MRF: with a lever p between
# them, rotational accommodation at the MRF would add p² K_R to the translational gain at the
# grasp.

LEAST_SHARE = 4.0
"""Of lighter payloads nobody can tell whether they slipped [N]."""

EMPTY = 0.25
"""An arm that exerts less than this part of its share of the weight carries nothing [1]."""

SLIPPED_S = 0.1
"""A payload has slipped when one arm carries nothing of it and the others all for so long [s]."""

STRAINS = ("internal_force", "internal_moment")
"""What is bounded of the wrenches at the grasps that move nothing."""

SHARES_PER_S = 1.0
"""The diagonals of W change by this factor of e at most [1/s]: the grasps follow within K_F k_e."""

BY_DRIVES = 0.25
"""What drives tell of a grasp comes late, and is given way to at this part of K_F [1]."""

_RANK = 0.02
"""Singular values of a Jacobian below this part of the greatest say nothing of a wrench [1]."""

OTHERS = 0.75
"""The others carry its part when they carry more than this of the whole [1]."""


class Grasping(NamedTuple):
    """k grasps of one payload in one tick; wrenches (k, 6) in the axes of the MRF."""

    p: Array
    """Where they are, seen from the MRF (k, 3) [m]."""
    desired: Array
    """Each arm's share of the weight, and of the wrench that an operator asks for."""
    exerted: tuple[Array | None, ...]
    """Wrench that each exerts (6,), None when stale."""
    contact: Array | None
    """Wrench (6,) of the payload on what it touches, or that speeds it up; None without all."""
    internal_force: float | None
    """Greatest force that moves nothing, beyond what the shares mean [N]; None without all."""
    internal_moment: float | None
    """Greatest such moment [N·m]."""

    def vertical(self, i: int, up: Array) -> tuple[float, float | None]:
        """Return the force that an arm is to carry along `up` (3,), MRF axes, and carries [N]."""
        exerted = self.exerted[i]
        return float(up @ self.desired[i, :3]), None if exerted is None else float(up @ exerted[:3])

    def off(self, i: int) -> Array | None:
        """Return by how much one arm exerts too little (6,); None when stale."""
        exerted = self.exerted[i]
        return None if exerted is None else self.desired[i] - exerted

    def off_by_drives(self, i: int, k: Kinematics, pushed: Pushed | None) -> Array | None:
        """Return the same by the torques of the drives (6,); None for an arm that nothing pushes.

        While the sensor tells nothing, all of the wrench at the grasp is in the torques that push
        the joints: τ = −Jᵀh. Those of the arm's share are no push, nor is what friction explains.
        """
        if pushed is None or not pushed.touched:
            return None
        R = k.T_world_mrf.R
        J = jacobian_at(k.J, R @ self.p[i])
        meant = rotate_twist(R, self.desired[i]) @ J
        torque = beyond(pushed.external + meant, pushed)
        off = np.linalg.lstsq(J.T, torque, rcond=_RANK)[0]
        return rotate_twist(R.T, np.asarray(off, dtype=np.float64))

    def to_mrf(self, i: int, twist: Array, R_world_mrf: Array) -> Array:
        """Return a twist (6,) of one grasp at the MRF, World axes."""
        return twist_at(twist, -(R_world_mrf @ self.p[i]))


def grasping(
    views: Sequence[Pose],
    tools: Sequence[Pose],
    felt: Sequence[Array | None],
    weights: Array,
    weight: Array,
    asked: Array,
) -> Grasping:
    """Return the forces at k grasps that hold a payload up and exert a wrench, at and in the MRF.

    `weight` (6,) holds it up, `asked` (6,) is what it is to exert; `views` are T_wrist_mrf, `tools`
    where each arm's grasp is in its Wrist, `felt` what each exerts (6,) at and in its grasp, None
    when stale; `weights` (k, 6) are the diagonals of W.
    """
    placed = [view.inverse() @ tool for view, tool in zip(views, tools, strict=True)]
    p = np.array([T.p for T in placed])
    exerted = tuple(
        None if h is None else rotate_twist(T.R, h) for T, h in zip(placed, felt, strict=True)
    )
    known = [h for h in exerted if h is not None]
    desired = load_shares(p, weights, weight + asked)
    if len(known) < len(exerted):
        return Grasping(p, desired, exerted, None, None, None)
    each = np.array(known)
    # Shares that are not equal are no strain: they are meant.
    strain = internal(p, each - desired)
    force, moment = greatest(strain[:, :3]), greatest(strain[:, 3:])
    return Grasping(p, desired, exerted, total(p, each) - weight, force, moment)


def without_load(forces: Grasping, up: Array) -> tuple[Flags, Flags]:
    """Return which of k arms carry next to nothing of the payload, and of which others carry that.

    Both are (k,); `up` (3,) is the vertical in the axes of the MRF. What a payload rests on takes
    load off the others, too, or is pressed on by the arm that it takes the load off: nothing
    slipped, for an empty grasp exerts nothing in any direction. An arm whose sensor tells nothing
    may carry all: that saturates it.
    """
    meant = forces.desired[:, :3] @ up
    known = np.array([h is not None for h in forces.exerted])
    if not known.any() or meant.min() < LEAST_SHARE:
        nobody = np.zeros(len(meant), dtype=bool)
        return nobody, nobody
    carried = np.array([0.0 if h is None else float(h[:3] @ up) for h in forces.exerted])
    size = np.array([0.0 if h is None else sizes(h)[0] for h in forces.exerted])
    empty: Flags = known & (size < EMPTY * meant)
    if not known.all():
        return empty, empty
    return empty, empty & ((carried.sum() - carried) > OTHERS * meant.sum())


def light_s(before_s: Sequence[float], forces: Grasping, up: Array, period_s: float) -> list[float]:
    """Return how long each arm has been without load [s], one period after `before_s`.

    A payload that slipped has not come back when the others lose it, too: they would go after their
    shares of nothing. It has when the arm carries its part.
    """
    empty, slips = (flags.tolist() for flags in without_load(forces, up))
    return [
        s + period_s if slips[i] or (empty[i] and s >= SLIPPED_S) else 0.0
        for i, s in enumerate(before_s)
    ]


class GivingWay:
    """Forces at the grasps of one joint task, and how each arm gives way to them."""

    def __init__(self, section: JointTaskSection, arms: Sequence[Arm]) -> None:
        """Build it for the arms that hold the payload."""
        self._wrists = tuple(arm.wrist for arm in arms)
        self._tools = tuple(arm.p.T_wrist_tool for arm in arms)
        self._weights = np.array(section.shares)
        self._ramp = SHARES_PER_S * arms[0].p.period_s
        self._mass = section.payload.mass
        self._moment = self._mass * np.array(section.payload.com)
        force = section.sources.force
        self._most = (section.most_internal, section.most_internal_moment)
        self._threshold, self._leash = force.hold_threshold, force.hold_leash
        # Of its bound, as much as of that of forces.
        self._threshold_moment = force.hold_threshold * self._most[1] / self._most[0]

    def weights(self, told: Inputs, before: Sequence[GraspState]) -> Array:
        """Return the diagonals of W in effect (k, 6), on their way to what was told.

        All get there at the same time, along a straight line of their logarithms: of two arms each
        one's share goes one way. With drives off, or just taken hold of, they are there at once.
        """
        aim = self._weights if told.settings.shares is None else told.settings.shares
        now = np.array([held.weights for held in before])
        if told.intent is Intent.SEED or not now.all():
            return aim
        way = np.log(aim / now)
        most = float(np.abs(way).max())
        if most <= self._ramp:
            return aim
        ramped: Array = now * np.exp(self._ramp / most * way)
        return ramped

    def forces(
        self,
        told: Inputs,
        weights: Array,
        views: Sequence[Pose],
        wrists: Sequence[WristMemory],
        T_payload_mrf: Pose,
        R_world_mrf: Array,
        known: Weighed,
    ) -> Grasping:
        """Return the forces at the grasps of arms that see the MRF at `views` in their Wrists.

        `weights` (k, 6) are the diagonals of W in effect, `known` is what the grasps were found to
        carry beside what was told.
        """
        felt = [
            own_wrist.contact.at_mrf(memory.wrench, tool)[0]
            for own_wrist, memory, tool in zip(self._wrists, wrists, self._tools, strict=True)
        ]
        extra = known.load + known.waits
        mass, moment = self._mass + float(extra[0]), self._moment + extra[1:]
        weight = weight_of(mass, moment, T_payload_mrf, R_world_mrf)
        if known.aside.any():
            weight = weight + led_by(known.aside, T_payload_mrf, R_world_mrf)
        asked = desired_wrench(told.wrench_desired, told.R_world_wrench, R_world_mrf)
        return grasping(views, self._tools, felt, weights, weight, asked)

    def strained(self, forces: Grasping) -> str | None:
        """Return which bound the arms press each other beyond, None for none."""
        for name, size, most in zip(
            STRAINS, (forces.internal_force, forces.internal_moment), self._most, strict=True
        ):
            if size is not None and size > most:
                return name
        return None

    def twist(
        self,
        i: int,
        forces: Grasping,
        gain: Array,
        R_world_mrf: Array,
        k: Kinematics,
        inputs: Inputs,
        held: GraspState,
    ) -> tuple[Array, ForceState]:
        """Return the twist (6,) at the MRF by which one arm gives way at its grasp.

        `gain` (6,) is K_F along the axes of the MRF (Williams 1997, section 2.5). In HOLD only
        internal force and moment beyond a threshold are bled off, inside a leash from where the
        Wrist was when HOLD began. There an arm whose sensor tells nothing goes by its drives.
        """
        off, intent = forces.off(i), inputs.intent
        if intent is Intent.HOLD and off is None:
            off, gain = forces.off_by_drives(i, k, inputs.pushed), BY_DRIVES * gain
        twist = np.zeros(6) if off is None else rotate_twist(R_world_mrf, gain * off)
        if intent is Intent.MOVE:
            return forces.to_mrf(i, twist, R_world_mrf), ForceState()
        if intent is not Intent.HOLD:
            return np.zeros(6), ForceState()
        at = k.T_world_wrist.p
        began = at if held.force.hold is None else held.force.hold
        bled = bleed(
            held.force.bleeding,
            None if off is None else -off,
            twist,
            at - began,
            self._threshold,
            self._leash,
            self._threshold_moment,
        )
        return forces.to_mrf(i, bled.twist, R_world_mrf), ForceState(began, bled.bleeding)


# --- Where the arms of a joint task have its payload, in one tick ---------------------------------


class Grips:
    """The grasps of some arms on one payload."""

    def __init__(
        self, name: str, arms: Sequence[Arm], nominal: Sequence[Pose], period_s: float
    ) -> None:
        """Build them for a task's name; `nominal` are T_wrist_mrf at start."""
        self._name, self._arms, self._nominal = name, tuple(arms), tuple(nominal)
        self._part = 1.0 - math.exp(-period_s / FOLLOW_TIME_S)

    def misfit(self, q: Sequence[Array]) -> float:
        """Return how far the arms' views are from the mean of all [m], each at its q (n,)."""
        views = [
            arm.mechanism.pose_wrist(own) @ T
            for arm, own, T in zip(self._arms, q, self._nominal, strict=True)
        ]
        return max(apart(mean_of(views), view)[0] for view in views)

    def taken(
        self, measured: Sequence[Pose], before: Sequence[ArmMemory]
    ) -> tuple[list[GraspState], Pose]:
        """Return the grasps of arms whose Wrists were measured at poses in World, and the payload.

        Its pose is the mean of the nominal views; what an event told of goes on being counted.
        """
        mean = mean_of([T @ nominal for T, nominal in zip(measured, self._nominal, strict=True)])
        found = []
        for memory, T in zip(before, measured, strict=True):
            view = T.inverse() @ mean
            told = 0 if memory.held is None else memory.held.redefined
            found.append(GraspState(self._name, view, view, redefined=told))
        return found, mean

    def followed(
        self, wrists: Sequence[Pose], before: Sequence[ArmMemory]
    ) -> tuple[list[GraspState], Pose]:
        """Return the grasps one period later, and where the payload is in World.

        That is the mean of the views of arms whose Wrists are at poses in World; they follow it.
        """
        held = [_held(memory) for memory in before]
        mean = mean_of([T @ h.T_wrist_payload for T, h in zip(wrists, held, strict=True)])
        found = []
        for T, h in zip(wrists, held, strict=True):
            view = follow(h.T_wrist_payload, T, mean, self._part)
            moved, turned = apart(h.told, view)
            told = moved > TOLD[0] or turned > TOLD[1]
            found.append(
                evolve(
                    h,
                    T_wrist_payload=view,
                    told=view if told else h.told,
                    redefined=h.redefined + told,
                )
            )
        return found, mean


def _held(memory: ArmMemory) -> GraspState:
    if memory.held is None:
        raise ValueError("the arm holds nothing with others")
    return memory.held
