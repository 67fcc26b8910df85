"""What of the asked joint rates every barrier allows.

Scaled to the joint speed bounds first, and beside things to the tool's; then the nearest rates that
keep every barrier: self-motion is spent first, then speed along the path, and only then the path,
along which the tool would stop: it slides on along the barrier.
"""

from typing import Final, NamedTuple

import numpy as np

from ..frame_tree import Body
from ..mechanism.kinematics import Kinematics
from ..parameters import Parameters
from ..proximity.capsules import Placed
from ..scene import Scene
from ..spatial import Array, sizes
from ..state import Inputs, Memory, Settings
from .clearance import Levels, Shown
from .collision import Guard, Situation, Watch
from .joint_limits import JointRoom
from .programme import nearest
from .resisted import Resistance

ORDERED: Final = 1e-3
"""A source that asks for more than this means it; below, it makes up for noise [m/s, rad/s]."""

_ACCOMMODATION: Final = "force"


def ordered(twists: dict[str, Array], inputs: Inputs) -> bool:
    """Return whether anything but accommodation tells the arm to move.

    Noise of the force/torque sensor always asks for a little. News of obstacles needs no lease: an
    arm that nobody tells to move shall not be led away by it.
    """
    if inputs.jog is not None or inputs.posture is not None or inputs.wrench_desired.any():
        return True
    return any(
        max(sizes(twist)) > ORDERED for source, twist in twists.items() if source != _ACCOMMODATION
    )


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

    def __init__(self, p: Parameters, guard: Guard | None = None) -> None:
        self._p = p
        self.guard = guard
        T = p.period_s
        self.room = JointRoom(
            p.lower, p.upper, p.acceleration, p.jerk, p.velocity, p.leash, T, p.following_window
        )

    def nearest(
        self,
        memory: Memory,
        k: Kinematics,
        dq: Array,
        error: Array,
        settings: Settings,
        scene: Scene | None = None,
        base: Body | None = None,
        placed: Placed | None = None,
        by_joint: bool = False,
        ordered: bool = True,
    ) -> Allowed:
        """Return the rates nearest to dq (n,) [rad/s] that all bounds allow.

        `error` (n,) [rad] is the command's lead over the joints, which the leash bounds; `base` a
        Base that moves; `placed` where links are, where that is known. `by_joint`: the joints are
        commanded themselves, so that one at its bound is held there, and no other makes up for it.
        `ordered` tells whether somebody tells the arm to move.
        """
        q, V = memory.motion.q, settings.speed_factor * self._p.velocity
        dq, share, low, high, beyond = self.room.within(dq, V, q, error)
        limits: tuple[str, ...] = ("joint_speed",) if share < 1.0 else ()
        leash = self.room.leash(error) if beyond else None
        if leash is not None:
            limits += self._reasons(self.room.limits(q).left_by(dq), "joint_limit")
            limits += self._reasons(leash.left_by(dq), "leash")
        if by_joint and beyond:
            dq, beyond = np.clip(dq, low, high), False
        watch = None
        if self.guard is not None and settings.avoid:
            p, T = k.T_world_mrf.p, settings.T_wrist_mrf
            at = Situation(
                q, memory.motion.dq, error, p, k.J, T, scene, settings.speed_factor, base, placed
            )
            watch = self.guard.watch(at, dq, memory.levels, ordered)
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
            found = nearest(dq, k.J, low, high, V, self._p.resolve.characteristic_length, rows)
            dq, share = found.dq, share * found.share
            if found.fallback:
                limits += (found.fallback,)
            pace = share if held else pace * found.pace
        way = memory.sent[1] - memory.sent[2]
        held_up = self.room.resisted(dq, memory.motion.dq, way, error, memory.resistance)
        # An arm that may not move gives way at most, and is not held up.
        if held_up.share < 1.0 and memory.moving_since_s is not None:
            left = held_up.share
            dq, share, pace = left * dq, left * share, left * pace
            limits += (f"leash:{self._p.joints[held_up.joint]}",)
        if watch is None or broken is None or self.guard is None:
            return Allowed(dq, share, limits, pace, held_up.memory)
        shown = self.guard.shown(watch, broken)
        return Allowed(dq, share, limits, pace, held_up.memory, watch, shown)

    def _reasons(self, which: list[int], name: str) -> tuple[str, ...]:
        return tuple(f"{name}:{self._p.joints[i]}" for i in which)
