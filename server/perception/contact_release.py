"""Contact release: latches a contact until it is over, and tells how far the arm gave way."""

from collections import deque
from enum import Enum, auto

import numpy as np

from ..control.hold.pushed import Pushed, released
from ..control.hold.retreat import LOOKBACK_S
from ..control.parameters import Parameters
from ..control.spatial import Array
from ..control.state import Memory, Output
from ..mode import Mode
from ..runtime.events import Events
from .filters.collision import JointContact

OVER_S = 0.2
"""A touch is over once nothing has pushed for so long [s]."""

COMING_TO_REST_S = 0.5
"""What is felt so long after the arm came to rest, it ran into [s]."""

SETTLED_S = 0.3
"""An arm that asked for no retreat for so long has given way as far as it will [s]."""


class _Told(Enum):
    """What operators were told of giving way."""

    NOTHING = auto()
    GIVING = auto()
    GAVE = auto()
    STUCK = auto()


class ContactRelease:
    """Decides what a contact means in each mode."""

    def __init__(self, p: Parameters, events: Events) -> None:
        self._joints, self._T, self._events = p.joints.names, p.period_s, events
        self._leash = p.retreat_leash
        self.touched = False
        """True while something pushes that the arm has stopped for."""
        self.pushed: Pushed | None = None
        """The newest estimate, and whether the arm is to give way to it."""
        self._giving = False
        self._past: deque[tuple[Array, Output | None]] = deque(
            maxlen=round(LOOKBACK_S / p.period_s)
        )
        self._free: tuple[Array, Output | None] | None = None
        self._rested_s = np.inf
        self._free_s = self._settled_s = 0.0
        self._told = _Told.NOTHING

    def update(
        self,
        found: JointContact | None,
        pushed: Pushed | None,
        mode: Mode,
        memory: Memory,
        output: Output | None,
    ) -> None:
        """Take in whether contact was `found` in this tick, and the estimate behind it.

        `memory` and `output` are the tick's before.
        """
        if not mode.energised:
            self.reset()
            return
        self._rested_s = self._rested_s + self._T if memory.motion.stands() else 0.0
        if mode is Mode.ENABLED and not self.touched:
            self._giving, self._told = False, _Told.NOTHING
        if found is not None and not self.touched:
            self._found(found, mode)
        if self.touched:
            free = pushed is None or released(pushed)
            self._free_s = self._free_s + self._T if free else 0.0
            self.touched = self._free_s <= OVER_S
        if pushed is None:
            self.pushed = None
            return
        self._past.append((pushed.external, output))
        self.pushed = pushed
        if self._giving:
            external, at = (None, None) if self._free is None else self._free
            self.pushed = pushed._replace(
                touched=True,
                lasting=self.touched,
                free=external,
                wrench=_seen(output),
                free_wrench=_seen(at),
            )
        if self._giving and mode is Mode.HOLD:
            self._tell(pushed.external, memory)

    def reset(self) -> None:
        """Forget everything: the drives are off, or nothing is known."""
        self.touched = self._giving = False
        self.pushed = self._free = None
        self._past.clear()
        self._free_s, self._rested_s, self._told = 0.0, np.inf, _Told.NOTHING

    def _found(self, found: JointContact, mode: Mode) -> None:
        """Stop for contact that the arm ran into, and give way to it."""
        if not self._giving:
            if mode is not Mode.ENABLED and self._rested_s >= COMING_TO_REST_S:
                return
            self._tell_touched(found)
            known = len(self._past) == self._past.maxlen
            self._free = self._past[0] if known else None
        self.touched = self._giving = True
        self._free_s = 0.0

    def _tell(self, external: Array, memory: Memory) -> None:
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
            now = _Told.STUCK if self.touched else _Told.GAVE
        if now is self._told:
            return
        self._told = now
        j = int(np.argmax(np.abs(external)))
        joint, torque, way = self._joints[j], float(external[j]), state.travelled
        values: dict[str, str | float] = {"joint": joint, "torque_nm": torque, "travelled_rad": way}
        left = f"by {way:.4f} rad of {self._leash:g}; {joint} is left with {torque:+.1f} N·m"
        if now is _Told.GIVING:
            self._events.info("giving_way", f"to {torque:+.1f} N·m at {joint}", **values)
        elif now is _Told.GAVE:
            self._events.info("gave_way", left, **values)
        else:
            self._events.warning("still_pushed", f"gave way {left}, and is still pushed", **values)

    def _tell_touched(self, found: JointContact) -> None:
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
