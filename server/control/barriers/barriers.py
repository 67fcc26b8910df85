"""Barriers: the part of the asked joint rates that all of them allow."""

from collections.abc import Sequence

import numpy as np

from ..bodies.rates import ArmTick
from ..joints import Joints, joined, parts_of
from ..scene import Index
from ..spatial import Array, Motion
from .clearance import (
    Bases,
    CollisionConstraint,
    Levels,
    ProximityQuery,
)
from .programme import ATTITUDE, WIDEN, WIDEN_BESIDE, nearest
from .rows import JointLimits, Room, Rows, Within
from .together import PayloadLink, in_step, least_of, pulled_apart


class ConstraintSet:
    """The barriers of one cell, composed."""

    def __init__(
        self,
        joints: Sequence[Joints],
        period_s: float,
        length: float,
        guard: CollisionConstraint | None = None,
        trees: Sequence[Index] = (),
    ) -> None:
        """Build it for the joints of each mechanism; rotations weigh `length` [m/rad].

        `guard` keeps clearances. `trees` are the mechanisms that share joints, of each the one
        that has these first.
        """
        self._names = tuple(arm.names for arm in joints)
        self._velocities = tuple(arm.velocity for arm in joints)
        self._length = length
        self.guard = guard
        self.rooms = tuple(JointLimits(arm, period_s) for arm in joints)
        self.parts = parts_of([arm.n for arm in joints])
        """Where each mechanism's joints are among all."""
        self._counts = [arm.n for arm in joints]
        self._tool = np.repeat(np.arange(len(joints)), self._counts)
        self._trees = tuple(trees)

    def nearest(
        self,
        arms: Sequence[ArmTick],
        motion: Motion,
        levels: Levels,
        bases: Bases,
        links: Sequence[PayloadLink] = (),
    ) -> ProximityQuery | None:
        """Tell each mechanism the rates nearest to those it asks for that all bounds allow.

        `motion`, `levels` and `bases` are as in `CollisionConstraint.watch`; those of `links` hold
        one payload. Returns what is near; None where clearances are not kept.
        """
        guard, beyond = self.guard, False
        bounded, shares, leashes = [], [], []
        for i, arm in enumerate(arms):
            rates, leash = self._bounded(i, arm)
            bounded.append(rates)
            leashes.append(leash)
            shares.append(rates.share)
            beyond = beyond or rates.beyond
        dq = joined([rates.dq for rates in bounded])
        groups = (*self._trees, *[link.tools for link in links])
        if groups:
            dq, shares, links = in_step(dq, self._counts, shares, shares, groups, links)
        watch, rows, broken = None, None, None
        if guard is not None and arms[0].inputs.settings.avoid:
            watch = guard.watch(arms, motion, levels, bases, dq)
            beside = guard.tool_shares(watch)
            if groups and min(beside) < 1.0:
                _, beside, links = in_step(dq, self._counts, beside, beside, groups, links)
            for i, slow in enumerate(beside):
                if slow < 1.0:
                    dq = _slowed(dq, self.parts[i], slow)
                    shares[i] = slow * shares[i]
                    arms[i].limits += ("near_speed",)
            rows = watch.rows
            for arm, makes_way in zip(arms, guard.makes_way(watch), strict=True):
                arm.made_way = makes_way
            broken, any_broken = rows.broken(dq)
            if any_broken:
                named = guard.named(watch, broken)
                for arm, part in zip(arms, self.parts, strict=True):
                    if rows.concern(broken, part):
                        arm.limits += named
                beyond = True
        paces = list(shares)
        if links and not beyond:
            J = self._tools(arms)
            beyond = pulled_apart(J, dq, ATTITUDE * self._length, links)
        if beyond:
            J = self._tools(arms, of_paths=True)
            low = joined([rates.low for rates in bounded])
            high = joined([rates.high for rates in bounded])
            own = zip(arms, self._velocities, strict=True)
            V = joined([arm.inputs.pace * most for arm, most in own])
            wheels = [
                part.start
                for part, arm in zip(self.parts, arms, strict=True)
                if arm.found.wheels_commanded
            ]
            costs = [WIDEN_BESIDE if arm.stance.tool_stays else WIDEN for arm in arms]
            told, kept = (None, None) if rows is None else (rows[:2], rows.kept)
            found = nearest(
                dq, J, low, high, V, self._length, told, self._tool, links, tuple(wheels), costs,
                kept,
            )  # fmt: skip
            for i, (arm, leash) in enumerate(zip(arms, leashes, strict=True)):
                # Rates that all bounds of joints allow are inside the leash, and slower ones too.
                held = leash is not None and bool(leash.left_by(dq[self.parts[i]]))
                shares[i] *= float(found.share[i])
                paces[i] = shares[i] if held else paces[i] * float(found.pace[i])
                if found.fallback:
                    arm.limits += (found.fallback,)
            dq = found.dq
            if guard is not None and watch is not None and any(arm.made_way for arm in arms):
                dq = guard.slowed_to_limit(watch, dq)
            tools = [link.tools for link in links]
            shares, paces = least_of(tools, shares), least_of(tools, paces)
        self._hold_up(arms, dq, shares, paces, rows, groups)
        if guard is None or watch is None or broken is None:
            return None
        shown = guard.shown(watch, broken)
        for arm in arms:
            arm.shown = shown
        return watch

    def _tools(self, arms: Sequence[ArmTick], *, of_paths: bool = False) -> Array:
        """Return the Jacobians (t, 6, n) of the tools, or of their paths."""
        J = np.zeros((len(arms), 6, len(self._tool)))
        for i, (arm, part) in enumerate(zip(arms, self.parts, strict=True)):
            own, joints = arm.tool_jacobian(part)
            if of_paths and arm.path is not None:
                own = arm.path
            J[i][:, joints if own.shape[1] > self._counts[i] else part] = own
        return J

    def _bounded(self, i: int, arm: ArmTick) -> tuple[Within, Room | None]:
        """Return the rates of one mechanism inside its speed bounds, and its leash if needed."""
        room, q = self.rooms[i], arm.commanded.motion.q
        V = arm.inputs.pace * self._velocities[i]
        rates = room.within(arm.dq_asked, V, q, arm.error)
        if rates.share < 1.0:
            arm.limits += ("joint_speed",)
        standing = arm.found.n_locked
        if standing:
            rates.low[:standing] = rates.high[:standing] = 0.0
        if not rates.beyond:
            return rates, None
        dq, leash = rates.dq, room.leash(arm.error)
        arm.limits += self._reasons(i, room.limits(q).left_by(dq), "joint_limit")
        arm.limits += self._reasons(i, leash.left_by(dq), "leash")
        if arm.found.synchronized:
            part = _part_within(dq, rates.low, rates.high)
            rates = rates._replace(dq=part * dq, share=part * rates.share, beyond=False)
        elif arm.by_joint:
            rates = rates._replace(dq=np.clip(dq, rates.low, rates.high), beyond=False)
        return rates, leash

    def _hold_up(
        self,
        arms: Sequence[ArmTick],
        dq: Array,
        shares: Sequence[float],
        paces: Sequence[float],
        rows: Rows | None,
        groups: Sequence[Index],
    ) -> None:
        """Tell mechanisms the rates of those that nothing holds up: else they slow as a whole."""
        left = []
        for i, arm in enumerate(arms):
            rates = dq if len(arms) == 1 else dq[self.parts[i]]
            (_, before, _), _, sent = arm.commanded
            # The way of the command in the tick whose effect is measured now.
            share, joint, arm.resistance = self.rooms[i].resisted(
                rates, before, sent[1] - sent[2], arm.error, arm.resistance
            )
            # An arm that may not move gives way at most, and is not held up.
            left.append(share if arm.may_move else 1.0)
            if left[i] < 1.0:
                arm.limits += (f"leash:{self._names[i][joint]}",)
        least = min(left)
        if least < 1.0:
            if rows is not None:
                # A barrier between two may be kept by one that makes way for the other.
                left = [least] * len(left)
            left = least_of(groups, left)
            dq = np.repeat(left, self._counts) * dq
        for i, (arm, part) in enumerate(zip(arms, self.parts, strict=True)):
            arm.allowed = dq if len(arms) == 1 else dq[part]
            arm.share, arm.pace = left[i] * shares[i], left[i] * paces[i]

    def _reasons(self, i: int, which: list[int], name: str) -> tuple[str, ...]:
        return tuple(f"{name}:{self._names[i][j]}" for j in which)


def _part_within(dq: Array, low: Array, high: Array) -> float:
    """Return the part (0 to 1) of rates (n,) at which none is beyond its bounds (n,)."""
    bound = np.where(dq > 0.0, high, low)
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = np.where(dq == 0.0, 1.0, bound / dq)
    return min(1.0, max(0.0, float(parts.min())))


def _slowed(dq: Array, part: slice, share: float) -> Array:
    """Return rates dq (n,), those of one mechanism slowed to a share."""
    slowed = dq.copy()
    slowed[part] *= share
    return slowed
