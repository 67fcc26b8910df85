"""Requests for a mode: answered once the mode is reached, or cannot be reached any more."""

from dataclasses import dataclass

from ...protocols.codec import encode
from ...protocols.messages import requests
from ..mode import Mode, PendingAction
from ..refusals import Refused, Why
from ..runtime.events import Events
from .admission import Instant
from .inbox import QueuedMessage, refusal_reply
from .protective import ProtectiveStops
from .request_context import RequestContext

ENABLE_TIMEOUT_S = 3.0
"""Drives that are not in Operation enabled by then will not be [s]."""

_ENDS = {
    PendingAction.ENABLE: frozenset(Mode) - {Mode.READY},
    PendingAction.DISABLE: {Mode.FAULT},
    PendingAction.RESET: frozenset[Mode](),
}
"""Modes in which an action cannot succeed any more."""

_ALLOWED: dict[str, tuple[Mode, ...]] = {
    "enable": (Mode.READY, Mode.HOLD),
    "hold": (Mode.ENABLED, Mode.STOPPING, Mode.HOLD),
    "resume": (Mode.HOLD,),
    "disable": (Mode.ENABLED, Mode.STOPPING, Mode.HOLD),
    "reset": (Mode.FAULT,),
}
"""Modes in which each action may be asked for."""


@dataclass(frozen=True)
class _Pending:
    """A request that waits for its answer."""

    asked: QueuedMessage
    since_s: float


class ModeRequests:
    """The action that an operator asked for, and the request that waits for it."""

    def __init__(self, stops: ProtectiveStops, events: Events) -> None:
        self._stops, self._events = stops, events
        self.action = PendingAction.NONE
        self.hold = False
        """HOLD was asked for in this tick."""
        self.resume = False
        """To go on was asked for in this tick."""
        self._pending: _Pending | None = None

    def begin_tick(self) -> None:
        """Forget what was asked for one tick only."""
        self.hold = self.resume = False

    def take(
        self, message: requests.ModeRequest, asked: QueuedMessage, context: RequestContext
    ) -> requests.Reply | None:
        """Put a request in force; return its answer, None while it waits. Raises `Refused`."""
        mode = context.mode
        replaced = (self.action, message.action) if mode is Mode.READY else None
        if replaced == (PendingAction.ENABLE, "disable"):
            self.end_enable(context.now, "disable asked")
        elif mode not in _ALLOWED[message.action]:
            modes = " or ".join(_ALLOWED[message.action])
            raise Refused(Why.NOT_NOW, f"{message.action} needs mode {modes}, it is {mode}")
        if message.action in ("enable", "resume"):
            self._ready_to_move(context)
        if replaced == (PendingAction.DISABLE, "enable"):
            self.finish(context.now, None)  # READY it is: the drives go off, and then on again
        if self._pending is not None:
            raise Refused(Why.NOT_NOW, f"{self.action} is still under way")
        if message.action == "hold":
            self.hold = True
        elif mode is Mode.HOLD and message.action in ("enable", "resume"):
            self.resume = True
        else:
            self.action = PendingAction(message.action)
            self._pending = _Pending(asked, context.now.time_s)
            return None
        return requests.Reply(ok=True, tick=context.now.tick)

    def _ready_to_move(self, context: RequestContext) -> None:
        if self._stops.asked_by is not None:
            raise Refused(
                Why.PROTECTIVE_STOP, f"protective stop asked by {self._stops.asked_by} is latched"
            )
        units = context.units
        if units.missed:
            raise Refused(Why.SENSOR_STALE, f"{', '.join(units.missed)} is stale")
        if units.settings.avoid and units.obstacles.stop is not None:
            stale = units.obstacles.stop
            raise Refused(Why.SENSOR_STALE, f"the news of obstacle {stale} is stale")
        if units.touched:
            raise Refused(Why.TOUCHED, "what pushes the arm is still there")
        for joint in units.joint:
            if joint.reason_to_stop is not None:
                raise Refused(Why.NOT_NOW, f"{joint.reason_to_stop}: let go of it first")

    def settle(self, mode: Mode, context: RequestContext) -> None:
        """Answer the pending request once its action has succeeded, or has taken too long."""
        pending = self._pending
        if pending is None:
            return
        done = {
            PendingAction.ENABLE: mode is Mode.ENABLED,
            PendingAction.DISABLE: mode is Mode.READY and context.drives_off,
            PendingAction.RESET: mode is Mode.READY,
        }[self.action]
        late = context.now.time_s - pending.since_s > ENABLE_TIMEOUT_S
        if done:
            self.finish(context.now, None)
        elif late:
            self.finish(context.now, Refused(Why.STILL_WRONG, f"mode is still {mode}"))
        elif mode in _ENDS[self.action]:
            self.finish(context.now, Refused(Why.NOT_NOW, f"mode became {mode}"))

    def end_enable(self, now: Instant, reason: str) -> None:
        """Give up enabling: what was asked for before something else came is dead, not late."""
        if self.action is PendingAction.ENABLE:
            self.finish(now, Refused(Why.NOT_NOW, reason))

    def finish(self, now: Instant, refused: Refused | None) -> None:
        """End the pending action and answer its request."""
        pending, action = self._pending, self.action
        self._pending, self.action = None, PendingAction.NONE
        if pending is None:
            return
        if refused is None:
            reply = requests.Reply(ok=True, tick=now.tick)
        else:
            self._events.warning(f"{action}_failed", refused.detail, reason=refused.reason)
            reply = refusal_reply(refused, now)
        pending.asked.reply(encode(reply))
