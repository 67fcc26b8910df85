"""Release news: operators are told what was touched, and how far the arm gave way to it."""

from collections.abc import Sequence
from enum import Enum, auto

import numpy as np

from ...control.hold.pushed import Pushed
from ...control.spatial import sizes
from ...control.state import Memory
from ...runtime.events import Events
from ..filters.collision import JointContact
from .tool import ToolContact

SETTLED_S = 0.3
"""An arm that asked for no retreat for so long has given way as far as it will [s]."""


class _Told(Enum):
    """Stages of giving way that operators were told of."""

    NOTHING = auto()
    GIVING = auto()
    GAVE = auto()
    STUCK = auto()


class ReleaseNews:
    """Tells each stage of giving way once."""

    def __init__(
        self, joints: Sequence[str], leash: float | None, period_s: float, events: Events
    ) -> None:
        self._joints, self._leash, self._T, self._events = joints, leash, period_s, events
        self._settled_s = 0.0
        self._told = _Told.NOTHING

    def reset(self) -> None:
        """Begin anew: what is touched next is told from its first stage."""
        self._told = _Told.NOTHING

    def touched(self, found: JointContact | ToolContact) -> None:
        """Tell that the arm stops for contact."""
        if isinstance(found, ToolContact):
            self._events.warning(
                "touched",
                f"tool: {found.off_n:.1f} N off the load of {found.known_n:.1f} N, "
                f"contact means {found.bound_n:.1f}",
                joint="tool",
                force_n=found.off_n,
                bound_n=found.bound_n,
            )
            return
        joint = self._joints[found.joint]
        self._events.warning(
            "touched",
            f"{joint}: {found.torque:+.1f} N·m that nothing explains, "
            f"contact means {found.bound:g}",
            joint=joint,
            torque_nm=found.torque,
            bound_nm=found.bound,
        )

    def gives_way(self, pushed: Pushed, memory: Memory, tool_only: bool) -> None:
        """Tell how far an arm in HOLD has given way, and whether something still pushes it."""
        state = memory.retreat
        if state is None:
            return
        giving = state.rate > 0.0
        self._settled_s = 0.0 if giving else self._settled_s + self._T
        if giving:
            now = _Told.GIVING
        elif self._settled_s < SETTLED_S:
            return
        else:
            now = _Told.STUCK if pushed.lasting else _Told.GAVE
        if now is self._told:
            return
        self._told = now
        what, push, values = self._push(pushed, tool_only)
        way = values["travelled_rad"] = state.travelled
        left = f"by {way:.4f} rad of {self._leash:g}; {what} is left with {push}"
        if now is _Told.GIVING:
            self._events.info("giving_way", f"to {push} at {what}", **values)
        elif now is _Told.GAVE:
            self._events.info("gave_way", left, **values)
        else:
            self._events.warning("still_pushed", f"gave way {left}, and is still pushed", **values)

    def _push(self, pushed: Pushed, tool_only: bool) -> tuple[str, str, dict[str, str | float]]:
        """Return what is pushed, by how much, and the values of an event that says so."""
        if tool_only:
            force = 0.0
            if pushed.steady is not None and pushed.free_wrench is not None:
                force = sizes(pushed.steady - pushed.free_wrench)[0]
            return "the tool", f"{force:.1f} N", {"joint": "tool", "force_n": force}
        j = int(np.argmax(np.abs(pushed.external)))
        joint, torque = self._joints[j], float(pushed.external[j])
        return joint, f"{torque:+.1f} N·m", {"joint": joint, "torque_nm": torque}
