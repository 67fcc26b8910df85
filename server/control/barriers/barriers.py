"""What of the asked joint rates every barrier allows.

Scaled to the joint speed bounds first, and beside things to the tool's; then the nearest rates that
keep every barrier: self-motion is spent first, then speed along the path, and only then the path,
along which the tool would stop: it slides on along the barrier.
"""

from typing import NamedTuple

import numpy as np

from ..frame_tree import Body
from ..joints import Joints
from ..mechanism.kinematics import Kinematics
from ..proximity.capsules import Placed
from ..scene import Scene
from ..spatial import Array, Pose
from ..stop.trajectory import Motion
from .clearance import Levels, Shown
from .collision import Guard, Situation, Watch
from .joint_limits import JointRoom
from .programme import nearest
from .resisted import Resistance


class State(NamedTuple):
    """What barriers have to know of one tick."""

    motion: Motion
    """The commanded joints."""
    error: Array
    """How far the command was ahead of the joints (n,) [rad], which the leash bounds."""
    way: Array
    """Way of the command (n,) [rad] in the tick whose effect is measured now."""
    levels: Levels
    """Best gap so far of pairs that are below their bounds."""
    resistance: Resistance | None
    """What holds the arm up; None before the first tick."""
    may_move: bool
    speed_factor: float
    T_wrist_mrf: Pose
    keep_clear: bool = False
    """Clearances are kept."""
    scene: Scene | None = None
    base: Body | None = None
    """A Base that moves."""
    placed: Placed | None = None
    """Where links are, where that is known already."""
    by_joint: bool = False
    """Joints are commanded themselves: one at its bound is held, and no other makes up for it."""
    ordered: bool = True
    """Somebody tells the arm to move."""


class Allowed(NamedTuple):
    """Joint rates that keep every barrier."""

    dq: Array
    scale: float
    """Share of the asked tool motion that is left, on its path or sliding, 0 to 1."""
    limits: tuple[str, ...]
    """Names of what took the rest."""
    pace: float
    """Share of its own speed at which a path may go on, 0 to 1: it leads a tool that slides, and
    waits for one that the leash holds."""
    resistance: Resistance
    """What the next tick has to know of what holds the arm up."""
    watch: Watch | None = None
    """What is around the arm; None where clearances are not kept."""
    shown: Shown | None = None
    """The pairs that are near; None where clearances are not kept."""

    @property
    def levels(self) -> Levels:
        """What the next tick has to know of gaps that are below their bounds."""
        return {} if self.watch is None else self.watch.levels


class Allow:
    """The barriers of one cell, composed."""

    def __init__(
        self, joints: Joints, period_s: float, length: float, guard: Guard | None = None
    ) -> None:
        """Build it; rotations weigh `length` [m/rad], `guard` keeps clearances."""
        self._joints, self._length = joints, length
        self.guard = guard
        self.room = JointRoom(
            joints.lower,
            joints.upper,
            joints.acceleration,
            joints.jerk,
            joints.velocity,
            joints.leash,
            period_s,
            joints.following_window,
        )

    def nearest(self, dq: Array, k: Kinematics, state: State) -> Allowed:
        """Return the rates nearest to dq (n,) [rad/s] that all bounds allow.

        `k` are the kinematics of the commanded posture.
        """
        motion, error = state.motion, state.error
        q, V = motion.q, state.speed_factor * self._joints.velocity
        dq, share, low, high, beyond = self.room.within(dq, V, q, error)
        limits: tuple[str, ...] = ("joint_speed",) if share < 1.0 else ()
        leash = self.room.leash(error) if beyond else None
        if leash is not None:
            limits += self._reasons(self.room.limits(q).left_by(dq), "joint_limit")
            limits += self._reasons(leash.left_by(dq), "leash")
        if state.by_joint and beyond:
            dq, beyond = np.clip(dq, low, high), False
        watch = None
        if self.guard is not None and state.keep_clear:
            at = Situation(
                q,
                motion.dq,
                error,
                k.T_world_mrf.p,
                k.J,
                state.T_wrist_mrf,
                state.scene,
                state.speed_factor,
                state.base,
                state.placed,
            )
            watch = self.guard.watch(at, dq, state.levels, state.ordered)
            slow = self.guard.tool_share(watch)
            if slow < 1.0:
                dq, share, limits = slow * dq, slow * share, (*limits, "near_speed")
        rows, broken = None, None
        if watch is not None and self.guard is not None:
            rows = watch.rows
            broken, any_broken = rows.broken(dq)
            if any_broken:
                limits += self.guard.named(watch, broken)
                beyond = True
        pace = share
        if beyond:
            # Rates that all bounds of joints allow are inside the leash, and slower ones too.
            held = leash is not None and bool(leash.left_by(dq))
            found = nearest(dq, k.J, low, high, V, self._length, rows)
            dq, share = found.dq, share * float(found.share[0])
            if found.fallback:
                limits += (found.fallback,)
            pace = share if held else pace * float(found.pace[0])
        held_up = self.room.resisted(dq, motion.dq, state.way, error, state.resistance)
        # An arm that may not move gives way at most, and is not held up.
        if held_up.share < 1.0 and state.may_move:
            left = held_up.share
            dq, share, pace = left * dq, left * share, left * pace
            limits += (f"leash:{self._joints.names[held_up.joint]}",)
        if watch is None or broken is None or self.guard is None:
            return Allowed(dq, share, limits, pace, held_up.memory)
        shown = self.guard.shown(watch, broken)
        return Allowed(dq, share, limits, pace, held_up.memory, watch, shown)

    def _reasons(self, which: list[int], name: str) -> tuple[str, ...]:
        return tuple(f"{name}:{self._joints.names[i]}" for i in which)
