"""Weighing of a payload by its grasps: what nobody told of is held up, and not followed.

Force control gives way to whatever the grasps exert beyond their shares. A payload that weighs
otherwise than it was told reads like contact that never ends: the arms would sink, or rise, for as
long as one looks. Contact falls as the arms give way to it, weight does not. So the sum at the
grasps is looked at over a while: what of its vertical force, or of its moment about the horizontal,
stayed the same although the payload moved by what force control asked for, is weight. It counts as
the payload's from then on, wherever that is turned, and the vertical accommodation rests. Before
the first such judgement after the drives were switched on, force control gives way to a small part
of the sum only, so that a payload told very wrong does not fall meanwhile.
"""

import math
from typing import NamedTuple

import numpy as np

from ..grasps.held import Weighed
from ..rigid_body import wrench_to
from ..spatial import GRAVITY, Array, Pose, cross, rotation_log
from ..state import Intent

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
        return before._replace(sum=None, time_s=0.0)
    sum_now = _weight_in(told) + G * before.waits
    asked = bool((np.abs(told.twist) > ASKED).any())
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


def _weight_in(told: Told) -> Array:
    """Return the weight (4,) that a wrench would be: force [N], moment in the payload's axes [N·m].

    The moment is that of a force along the vertical: its point's place times the force.
    """
    up = told.T_payload_mrf.R @ told.T_world_mrf.R[2]
    wrench = wrench_to(told.T_payload_mrf, told.contact)  # type: ignore[arg-type]
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
