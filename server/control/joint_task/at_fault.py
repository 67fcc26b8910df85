"""Speed of a payload, bounded by the internal force that a fault would leave.

When a drive fails, an arm's brakes fall in or a bus goes silent, one joint or one arm comes to rest
otherwise than the rest, which is told some periods later and then takes its time on its ramps. By
how much the grasps end apart, times the stiffness of the pads, is the force. Arms are taken as
rigid: what drives and links yield makes it less. What is looked at, with T the period and r the
mean time that the ramps take, R/2 of the slowest joint in proportion to the speed:

- an arm stands at once, the others go on for T + r: its brakes hold at once, or its bus is
  unplugged, which is told after one SYNC that it does not answer;
- a drive is silent and stands, all others go on until it is told, `AWAITED` SYNCs later, and r;
- a joint or an arm without power goes on, and falls, until brakes hold and have stopped it, while
  the others are told within T of it, and stop on their ramps.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ....config.schema.joint_task import JointTaskSection
from ..arm.arm import Arm
from ..compiled import MATRIX, NUMBER, ROW, VECTOR, compiled
from ..mechanism.dynamics import Dynamics
from ..rigid_body import jacobian_at, skew
from ..spatial import Array, Pose, rotation_log

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


@compiled(MATRIX, VECTOR)
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
