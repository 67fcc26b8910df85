"""Requests for a mode: answered once the mode is reached, or cannot be reached any more."""

from dataclasses import dataclass

from ...protocols.codec import encode
from ...protocols.messages import requests
from ..commands.settings import OperatorSettings
from ..mode import Mode, Wish
from ..refusals import Refused, Why
from ..runtime.events import Events
from .admission import Instant
from .inbox import QueuedMessage, refusal_reply
from .protective import ProtectiveStops
from .request_context import RequestContext

ENABLE_TIMEOUT_S = 3.0
"""Drives that are not in Operation enabled by then will not be [s]."""

_ENDS = {
    Wish.ENABLE: frozenset(Mode) - {Mode.READY},
    Wish.DISABLE: {Mode.FAULT},
    Wish.RESET: frozenset[Mode](),
}
"""Modes in which a wish cannot come about any more."""

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
    """The mode that an operator wishes for, and the request that waits for it."""

    def __init__(self, settings: OperatorSettings, stops: ProtectiveStops, events: Events) -> None:
        self._settings, self._stops, self._events = settings, stops, events
        self.wish = Wish.NONE
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
        replaced = (self.wish, message.action) if mode is Mode.READY else None
        if replaced == (Wish.ENABLE, "disable"):
            self.end_enable(context.now, "disable asked")
        elif mode not in _ALLOWED[message.action]:
            modes = " or ".join(_ALLOWED[message.action])
            raise Refused(Why.NOT_NOW, f"{message.action} needs mode {modes}, it is {mode}")
        if message.action in ("enable", "resume"):
            self._ready_to_move(context)
        if replaced == (Wish.DISABLE, "enable"):
            self.finish_wish(context.now, None)  # READY it is: the drives go off, and then on again
        if self._pending is not None:
            raise Refused(Why.NOT_NOW, f"{self.wish} is still under way")
        if message.action == "hold":
            self.hold = True
        elif mode is Mode.HOLD and message.action in ("enable", "resume"):
            self.resume = True
        else:
            self.wish = Wish(message.action)
            self._pending = _Pending(asked, context.now.time_s)
            return None
        return requests.Reply(ok=True, tick=context.now.tick)

    def _ready_to_move(self, context: RequestContext) -> None:
        if self._stops.asked_by is not None:
            raise Refused(
                Why.PROTECTIVE_STOP, f"protective stop asked by {self._stops.asked_by} is latched"
            )
        if context.essential_stale:
            raise Refused(Why.SENSOR_STALE, f"{', '.join(context.essential_stale)} is stale")
        if self._settings.avoid and context.obstacles.stop is not None:
            stale = context.obstacles.stop
            raise Refused(Why.SENSOR_STALE, f"the news of obstacle {stale} is stale")
        if context.touched:
            raise Refused(Why.TOUCHED, "what pushes the arm is still there")

    def settle(self, mode: Mode, context: RequestContext) -> None:
        """Answer the pending wish once it has come about or has taken too long."""
        pending = self._pending
        if pending is None:
            return
        done = {
            Wish.ENABLE: mode is Mode.ENABLED,
            Wish.DISABLE: mode is Mode.READY and context.drives_off,
            Wish.RESET: mode is Mode.READY,
        }[self.wish]
        late = context.now.time_s - pending.since_s > ENABLE_TIMEOUT_S
        if done:
            self.finish_wish(context.now, None)
        elif late:
            self.finish_wish(context.now, Refused(Why.STILL_WRONG, f"mode is still {mode}"))
        elif mode in _ENDS[self.wish]:
            self.finish_wish(context.now, Refused(Why.NOT_NOW, f"mode became {mode}"))

    def end_enable(self, now: Instant, reason: str) -> None:
        """Give up enabling: what was asked for before something else came is dead, not late."""
        if self.wish is Wish.ENABLE:
            self.finish_wish(now, Refused(Why.NOT_NOW, reason))

    def finish_wish(self, now: Instant, refused: Refused | None) -> None:
        """End the pending wish and answer it."""
        pending, wish = self._pending, self.wish
        self._pending, self.wish = None, Wish.NONE
        if pending is None:
            return
        if refused is None:
            reply = requests.Reply(ok=True, tick=now.tick)
        else:
            self._events.warning(f"{wish}_failed", refused.detail, reason=refused.reason)
            reply = refusal_reply(refused, now)
        pending.asked.reply(encode(reply))
