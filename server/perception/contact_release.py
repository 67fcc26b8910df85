"""Contact release: latches a contact until it is over, and tells how far the arm gave way."""

from collections import deque
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from ..control.hold.pushed import Pushed, released, tool_released
from ..control.hold.retreat import LOOKBACK_S
from ..control.parameters import Parameters
from ..control.spatial import Array, sizes
from ..control.state import Memory, Output
from ..mode import Mode
from ..runtime.events import Events
from .filters.collision import JointContact
from .tool_contact import MARGIN_N, ToolContact

OVER_S = 0.2
"""A touch is over once nothing has pushed for so long [s]."""

COMING_TO_REST_S = 0.5
"""A contact that is felt so long after the arm came to rest is one that it ran into [s]."""

STEADY_S = 0.2
"""The wrench on the tool is averaged over this time [s]."""

SETTLED_S = 0.3
"""An arm that asked for no retreat for so long has given way as far as it will [s]."""


class _Told(Enum):
    """Stages of giving way that operators were told of."""

    NOTHING = auto()
    GIVING = auto()
    GAVE = auto()
    STUCK = auto()


class _Push(NamedTuple):
    """Push that was measured in a tick: at the joints (n,), and at the tool (6,) if it is seen."""

    external: Array | None = None
    wrench: Array | None = None
    steady: Array | None = None
    """The mean of that over the last ticks; None where nobody asks for it."""


class ContactRelease:
    """Decides what a contact means in each mode."""

    def __init__(self, p: Parameters, events: Events, in_tunnels: bool = False) -> None:
        """Build it; an arm `in_tunnels` may be told to withdraw from what still pushes it."""
        self._in_tunnels = in_tunnels
        self._joints, self._T, self._events = p.joints.names, p.period_s, events
        self._leash = p.retreat_leash
        self.touched = False
        """True while something pushes that the arm has stopped for."""
        self.withdraws = False
        """An arm in tunnels has stopped for it: from now on it may move, and only back."""
        self.pushed: Pushed | None = None
        """The newest estimate, and whether the arm is to give way to it."""
        self._giving = False
        self._past: deque[_Push] = deque(maxlen=round(LOOKBACK_S / p.period_s))
        self._free: _Push | None = None
        self._tool_free: Array | None = None
        """Mean wrench on the tool (6,), the newest before it was touched."""
        self._seen: deque[Array] = deque(maxlen=max(1, round(STEADY_S / p.period_s)))
        """The latest wrenches on the tool (6,) each."""
        self._rested_s = np.inf
        self._free_s = self._settled_s = self._tool_free_s = 0.0
        self._tool = self._tool_lasting = False
        self._told = _Told.NOTHING

    def update(
        self,
        found: JointContact | None,
        tool: ToolContact | None,
        pushed: Pushed | None,
        mode: Mode,
        memory: Memory | None,
        output: Output | None,
    ) -> None:
        """Take in whether contact was `found` in this tick, and the estimate behind it.

        `tool` is contact of the tool while its load is not explained. `memory` and `output` are the
        tick's before.
        """
        if not mode.energised or memory is None:
            self.reset()
            return
        self._rested_s = self._rested_s + self._T if memory.motion.stands() else 0.0
        touched = self.touched or (tool is not None and tool.touched and self._tool)
        if mode is Mode.ENABLED and not touched:
            self._giving = self._tool = self._tool_lasting = False
            self._told = _Told.NOTHING
        if found is not None and not self.touched:
            self._found(found, mode)
        if tool is None or not tool.free:
            self._tool_free = self._tool_free if tool is not None else None
        elif self._past and not self._giving:
            self._tool_free = self._past[0].steady
        # The reading changes with what is told of the load: then the change is nobody's push.
        self._tool &= tool is not None
        if tool is not None and tool.found and not self._tool:
            self._found(tool, mode)
        if self.touched:
            free = pushed is None or released(pushed)
            self._free_s = self._free_s + self._T if free else 0.0
            self.touched = self._free_s <= OVER_S
        stood = mode is Mode.HOLD and self._in_tunnels
        self.withdraws = self.touched and (self.withdraws or stood)
        if pushed is None:
            self.pushed = None
            return
        wrench = _seen(output)
        if wrench is not None:
            self._seen.append(wrench)
        steady = None
        if wrench is not None and (tool is not None or self._giving):
            steady = np.mean(self._seen, axis=0)
        self._past.append(_Push(pushed.external, wrench, steady))
        self.pushed = pushed
        if self._giving:
            earlier = _Push() if self._free is None else self._free
            self.pushed = pushed._replace(
                touched=True,
                free=earlier.external,
                wrench=wrench,
                steady=steady,
                free_wrench=earlier.wrench,
                tool_bound=MARGIN_N if self._tool else None,
            )
            self._tool_free_s = self._tool_free_s + self._T if tool_released(self.pushed) else 0.0
            self._tool_lasting = self._tool and self._tool_free_s <= OVER_S
            self.pushed = self.pushed._replace(lasting=self.touched or self._tool_lasting)
        if self._giving and mode is Mode.HOLD:
            self._tell(self.pushed, memory)

    def reset(self) -> None:
        """Forget everything: the drives are off, or nothing is known."""
        self.touched = self.withdraws = False
        self._giving = self._tool = self._tool_lasting = False
        self.pushed = self._free = self._tool_free = None
        self._past.clear()
        self._seen.clear()
        self._free_s, self._rested_s, self._told = 0.0, np.inf, _Told.NOTHING

    def _found(self, found: JointContact | ToolContact, mode: Mode) -> None:
        """Stop for contact that the arm ran into, and give way to it."""
        if not self._giving:
            if mode is not Mode.ENABLED and self._rested_s >= COMING_TO_REST_S:
                return
            self._tell_touched(found)
            known = len(self._past) == self._past.maxlen
            self._free = self._past[0] if known else None
            if isinstance(found, ToolContact) and known and self._tool_free is not None:
                # Its bound is wider than a joint's, and contact may have begun long ago.
                self._free = _Push(self._past[0].external, self._tool_free)
        self._giving = True
        if isinstance(found, ToolContact):
            # It may be more load: resume stays allowed.
            self._tool, self._tool_free_s = True, 0.0
        else:
            self.touched, self._free_s = True, 0.0

    def _tell(self, pushed: Pushed, memory: Memory) -> None:
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
        what, push, values = self._push(pushed)
        way = values["travelled_rad"] = state.travelled
        left = f"by {way:.4f} rad of {self._leash:g}; {what} is left with {push}"
        if now is _Told.GIVING:
            self._events.info("giving_way", f"to {push} at {what}", **values)
        elif now is _Told.GAVE:
            self._events.info("gave_way", left, **values)
        else:
            self._events.warning("still_pushed", f"gave way {left}, and is still pushed", **values)

    def _push(self, pushed: Pushed) -> tuple[str, str, dict[str, str | float]]:
        """Return what is pushed, by how much, and the values of an event that says so."""
        if self._tool and not self.touched:
            force = 0.0
            if pushed.steady is not None and pushed.free_wrench is not None:
                force = sizes(pushed.steady - pushed.free_wrench)[0]
            return "the tool", f"{force:.1f} N", {"joint": "tool", "force_n": force}
        j = int(np.argmax(np.abs(pushed.external)))
        joint, torque = self._joints[j], float(pushed.external[j])
        return joint, f"{torque:+.1f} N·m", {"joint": joint, "torque_nm": torque}

    def _tell_touched(self, found: JointContact | ToolContact) -> None:
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


def _seen(output: Output | None) -> Array | None:
    """Return what pushes the tool (6,), at the MRF in World axes, as far as the sensor sees."""
    if output is None or output.wrench_mrf is None:
        return None
    return -(output.wrench_mrf.reshape(2, 3) @ output.T_world_mrf_measured.R.T).ravel()
