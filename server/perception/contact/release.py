"""Contact release: latches a contact until it is over, and tells how far the arm gave way."""

from collections import deque
from typing import NamedTuple

import numpy as np

from ...control.hold.pushed import Pushed, released, tool_released
from ...control.hold.retreat import LOOKBACK_S
from ...control.parameters import Parameters
from ...control.spatial import Array
from ...control.state import Memory, Output
from ...mode import Mode
from ...runtime.events import Events
from ..filters.collision import JointContact
from .release_news import ReleaseNews
from .tool import MARGIN_N, ToolContact

OVER_S = 0.2
"""A touch is over once nothing has pushed for so long [s]."""

COMING_TO_REST_S = 0.5
"""A contact that is felt so long after the arm came to rest is one that it ran into [s]."""

STEADY_S = 0.2
"""The wrench on the tool is averaged over this time [s]."""


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
        self._T = p.period_s
        self._news = ReleaseNews(p.joints.names, p.retreat_leash, p.period_s, events)
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
        self._free_s = self._tool_free_s = 0.0
        self._tool = self._tool_lasting = False

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
        self._latch(found, tool, mode)
        self._last(pushed, mode)
        if pushed is None:
            self.pushed = None
            return
        self._keep(pushed, tool, output)
        self.pushed = self._given_way_to(pushed) if self._giving else pushed
        if self._giving and mode is Mode.HOLD:
            self._news.gives_way(self.pushed, memory, self._tool and not self.touched)

    def _latch(self, found: JointContact | None, tool: ToolContact | None, mode: Mode) -> None:
        """Begin to give way to contact that is new; end where the arm may move again."""
        touched = self.touched or (tool is not None and tool.touched and self._tool)
        if mode is Mode.ENABLED and not touched:
            self._giving = self._tool = self._tool_lasting = False
            self._news.reset()
        if found is not None and not self.touched:
            self._found(found, mode)
        if tool is None:
            # The reading changes with what is told of the load: then the change is nobody's push.
            self._tool_free, self._tool = None, False
            return
        if tool.free and self._past and not self._giving:
            self._tool_free = self._past[0].steady
        if tool.found and not self._tool:
            self._found(tool, mode)

    def _last(self, pushed: Pushed | None, mode: Mode) -> None:
        """Let a touch last until nothing has pushed the joints for a while."""
        if self.touched:
            free = pushed is None or released(pushed)
            self._free_s = self._free_s + self._T if free else 0.0
            self.touched = self._free_s <= OVER_S
        stood = mode is Mode.HOLD and self._in_tunnels
        self.withdraws = self.touched and (self.withdraws or stood)

    def _keep(self, pushed: Pushed, tool: ToolContact | None, output: Output | None) -> None:
        """Keep what pushes now: what is touched next is judged by what was before."""
        wrench, steady = _seen(output), None
        if wrench is not None:
            self._seen.append(wrench)
            if tool is not None or self._giving:
                steady = np.mean(self._seen, axis=0)
        self._past.append(_Push(pushed.external, wrench, steady))

    def _given_way_to(self, pushed: Pushed) -> Pushed:
        """Return the estimate with what the newest push is compared with."""
        now, earlier = self._past[-1], _Push() if self._free is None else self._free
        told = pushed._replace(
            touched=True,
            free=earlier.external,
            wrench=now.wrench,
            steady=now.steady,
            free_wrench=earlier.wrench,
            tool_bound=MARGIN_N if self._tool else None,
        )
        self._tool_free_s = self._tool_free_s + self._T if tool_released(told) else 0.0
        self._tool_lasting = self._tool and self._tool_free_s <= OVER_S
        return told._replace(lasting=self.touched or self._tool_lasting)

    def reset(self) -> None:
        """Forget everything: the drives are off, or nothing is known."""
        self.touched = self.withdraws = False
        self._giving = self._tool = self._tool_lasting = False
        self.pushed = self._free = self._tool_free = None
        self._past.clear()
        self._seen.clear()
        self._free_s, self._rested_s = 0.0, np.inf
        self._news.reset()

    def _found(self, found: JointContact | ToolContact, mode: Mode) -> None:
        """Stop for contact that the arm ran into, and give way to it."""
        if not self._giving:
            if mode is not Mode.ENABLED and self._rested_s >= COMING_TO_REST_S:
                return
            self._news.touched(found)
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


def _seen(output: Output | None) -> Array | None:
    """Return what pushes the tool (6,), at the MRF in World axes, as far as the sensor sees."""
    if output is None or output.wrench_mrf is None:
        return None
    return -(output.wrench_mrf.reshape(2, 3) @ output.T_world_mrf_measured.R.T).ravel()
