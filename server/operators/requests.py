"""Requests of one period: admitted, answered, and their change of lease, mode and settings."""

import hashlib
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import islice

from ...protocols.codec import Reason, encode, text_field
from ...protocols.messages import messages as m
from ...protocols.messages import requests
from ...protocols.messages.messages import Command, Keepalive
from ...protocols.messages.perception import (
    AvoidanceRequest,
    ContourNews,
    FrameNews,
    ObstacleNews,
    Sighting,
)
from ...protocols.proof import Proof
from ...protocols.topics import MODE, PROTECTIVE_STOP, Flow
from ..events import Events
from ..mode import Mode, PendingAction
from ..reflection import Reflector
from ..refusals import Refused, Why, refusing_errors
from ..units.unit import Unit
from ..units.units import JointUnit, Units, serve_unit
from .admission import Admission, Grants, Instant
from .inbox import Inbox, QueuedMessage, Refusal, refusal_reply

# --- The state of the daemon that a request may depend on -----------------------------------------


@dataclass(frozen=True)
class RequestContext:
    """State of mode, arms and drives in the tick that answers a request."""

    now: Instant
    mode: Mode
    units: Units
    """The arms, with what is commanded and perceived of each."""
    drives_off: bool = True
    """All drives have said that they are off, after what they were last told."""


# --- The protective stops that are latched, and who may clear them. Pure --------------------------

MOST = 16
"""Most sealed stops that are kept apart; further ones are the lease holder's to clear [1]."""


class ProtectiveStops:
    """Every stop that was asked for and is not cleared; the arm may move once there is none.

    Each is kept on its own: whoever asks for one cannot clear another's by clearing that.
    """

    def __init__(self) -> None:
        self._sealed: dict[bytes, str] = {}
        self._unsealed: str | None = None
        self.asked_by: str | None = None
        """Name of an operator whose stop is latched, None without any."""

    def latch(self, operator: str, seal: bytes | None) -> None:
        """Latch a stop; `seal` is the SHA-256 of what clears it, None where only a lease does."""
        if seal is not None and (seal in self._sealed or len(self._sealed) < MOST):
            self._sealed[seal] = operator
        else:
            self._unsealed = operator
        self._find_asker()

    def clear(self) -> None:
        """Clear all, for the lease's holder."""
        self._sealed.clear()
        self._unsealed = self.asked_by = None

    def open(self, opens: bytes | None) -> None:
        """Clear the stop whose seal this opens. Raises `Refused` where it opens none."""
        seal = hashlib.sha256(opens or b"").digest()
        if opens is None or self._sealed.pop(seal, None) is None:
            asker = self.asked_by
            raise Refused(
                Why.NOT_YOURS, f"asked by {asker}: {asker}'s seal or a proof of the lease clears it"
            )
        self._find_asker()

    def _find_asker(self) -> None:
        self.asked_by = self._unsealed or next(reversed(self._sealed.values()), None)


# --- Requests for a mode: answered once the mode is reached, or cannot be reached any more --------

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


# --- A tunnel that an operator tells: answered once the joints are fitted to it, and it holds -----


AT_ONCE = 60
"""With drives off so many parts are fitted in a period [1]."""


class TunnelRequests:
    """The request for a tunnel that waits while joints are fitted to it, a part in each period."""

    def __init__(self, admission: Admission, events: Events) -> None:
        self._admission, self._events = admission, events
        self._asked: QueuedMessage | None = None
        self._fitting: Iterator[None] = iter(())
        self._epoch = 0

    def take(self, message: m.TunnelRequest, asked: QueuedMessage, context: RequestContext) -> None:
        """Begin to fit joints to a tunnel. Raises `Refused`."""
        if self._asked is not None:
            raise Refused(Why.NOT_NOW, "joints are still being fitted to the tunnel before")
        self._asked, self._epoch = asked, self._admission.lease.epoch
        self._fitting = context.units.refitting(message)

    def go_on(self, context: RequestContext) -> None:
        """Fit a part, many with drives off; answer once the tunnel holds, or cannot."""
        asked = self._asked
        if asked is None:
            return
        try:
            self._require(context.mode)
            parts = AT_ONCE if context.drives_off else 1
            with refusing_errors:
                fitted = sum(1 for _ in islice(self._fitting, parts))
            if fitted == parts:
                return
            reply = requests.Reply(ok=True, tick=context.now.tick)
        except Refused as refused:
            self._events.refused("request", asked.topic.key, refused.reason, refused.detail)
            reply = refusal_reply(refused, context.now)
        self._asked, self._fitting = None, iter(())
        asked.reply(encode(reply))

    def _require(self, mode: Mode) -> None:
        if mode in (Mode.BOOT, Mode.FAULT):
            raise Refused(Why.NOT_NOW, f"no tunnel is told in mode {mode}")
        lease = self._admission.lease
        if lease.holder is None or lease.epoch != self._epoch:
            raise Refused(Why.NO_LEASE, "the lease ended while joints were fitted to the tunnel")


# --- Services: the answer to every request, which changes the lease, the mode or settings ---------


class Services:
    """Answers requests; keeps the protective stops, and requests for a mode that wait."""

    def __init__(
        self,
        admission: Admission,
        events: Events,
        grants: Grants,
    ) -> None:
        self._admission = admission
        self._events = events
        self._grants = grants
        self.stops = ProtectiveStops()
        """The protective stops that are latched."""
        self.modes = ModeRequests(self.stops, events)
        self.tunnels = TunnelRequests(admission, events)

    def serve(self, asked: QueuedMessage, context: RequestContext) -> None:
        """Answer one request, or let it wait: until a mode is reached, or joints are fitted.

        What is raised on the way refuses it; but who asks the arm to stop has it stopped by that.
        """
        stops = asked.topic in (PROTECTIVE_STOP, MODE)
        try:
            with nullcontext() if stops else refusing_errors:
                message = self._admission.admit(
                    asked.topic, asked.payload, asked.proof, context.now
                )
                reply = self._act(message, asked, context)
        except Refused as refused:
            self._events.refused("request", asked.topic.key, refused.reason, refused.detail)
            reply = refusal_reply(refused, context.now)
        if reply is not None:
            asked.reply(encode(reply))

    # --- one method per request --------------------------------------------------------------

    def _act(
        self, message: m.Message, asked: QueuedMessage, context: RequestContext
    ) -> requests.Reply | None:
        ok = requests.Reply(ok=True, tick=context.now.tick)
        match message:
            case requests.LeaseRequest():
                granted = self._grants.grant(message, context.now)
                self._events.info("lease_granted", message.operator, epoch=granted.epoch)
                self._events.remind()
                return granted
            case requests.LeaseRelease():
                self._events.info("lease_released", self._admission.lease.holder or "")
                self._admission.end()
            case requests.ModeRequest():
                return self.modes.take(message, asked, context)
            case requests.ProtectiveStop():
                self.stops.latch(message.operator, message.seal)
                self._events.warning("protective_stop", f"asked by {message.operator}")
            case requests.ProtectiveClear():
                return self._clear(message, asked.proof, context)
            case requests.SpeedRequest():
                context.units.settings.speed_factor = message.factor
                self._events.info("speed_set", "", factor=message.factor)
            case AvoidanceRequest():
                self._switch_avoidance(message.on, context.units)
            case requests.HoldTogether():
                context.units.hold_together(message.task, message.on)
            case requests.MarkRequest():
                self._events.info("marked", message.text)
            case m.TunnelRequest():
                self.tunnels.take(message, asked, context)
                return None
            case m.TaskCommand() | m.MechanismCommand():
                serve_unit(message, context.units.of(message))
            case _:
                raise Refused(Why.NOT_NOW, f"no service for {asked.topic.key}")
        return ok

    def _switch_avoidance(self, on: bool, units: Units) -> None:
        if on and not units.settings.can_avoid:
            raise Refused(Why.NOT_NOW, "the cell says nothing of avoidance")
        units.settings.avoid = on
        self._events.info("avoidance_switched", "", on=on)

    def _clear(
        self, message: requests.ProtectiveClear, proof: Proof | None, context: RequestContext
    ) -> requests.Reply:
        if self.stops.asked_by is None:
            return requests.Reply(ok=True, tick=context.now.tick)
        if self._admission.holds(proof, context.now):
            self.stops.clear()
        else:
            self.stops.open(message.opens)
        left = self.stops.asked_by
        detail = f"by {message.operator}" + (f"; that of {left} is latched" if left else "")
        self._events.info("protective_stop_cleared", detail)
        return requests.Reply(ok=True, tick=context.now.tick, detail=detail[:500])


# --- Dispatcher: answers the requests of one period, admits commands and puts them in force -------


class Dispatcher:
    """Hands received messages to services, lease, and the commands and perception of units."""

    def __init__(
        self,
        inbox: Inbox,
        admission: Admission,
        services: Services,
        units: Units,
        events: Events,
    ) -> None:
        self._inbox = inbox
        self._admission = admission
        self._services = services
        self._units = units
        self._events = events

    def take(self, context: RequestContext) -> None:
        """Take what has come."""
        now_s = context.now.time_s
        self._services.modes.begin_tick()
        holder = self._admission.lease.holder
        if holder is not None and not self._admission.lease.alive(now_s):
            self._events.warning("lease_expired", holder)
            self._admission.end()
        self._inbox.sort(context.now)
        for refusal in self._inbox.refusals():
            self._answer(refusal, context)
        for asked in self._inbox.requests():
            self._services.serve(asked, context)
        self._services.tunnels.go_on(context)
        for queued in self._inbox.commands():
            self._command(queued, context)
        for queued in self._inbox.sensors():
            self._news(queued, context)
        for refusal in self._inbox.refusals():
            self._answer(refusal, context)
        self._units.obstacles.update(context.now.tick)
        for unit in self._units.each:
            if unit.vision.watching:
                unit.vision.update(context.now.tick)
            if unit.perception.passage is not None:
                unit.perception.passage.update(context.now.tick)
        for commanded in self._units.all:
            if commanded.commands.dropped:
                _tell_dropped(commanded)
            if commanded.commands.reflector is not None:
                _look_at_energy(commanded.commands.reflector, commanded.events)
            for name in commanded.commands.expired(now_s):
                commanded.events.info("stream_expired", name)

    def listen(self, now: Instant) -> None:
        """Sort what has come while nothing else is due."""
        self._inbox.sort(now)

    @property
    def pressed(self) -> bool:
        """True while so much junk comes in that it should be sorted more often."""
        return self._inbox.pressed

    def _command(self, queued: QueuedMessage, context: RequestContext) -> None:
        try:
            with refusing_errors:
                message = self._admission.admit(
                    queued.topic, queued.payload, queued.proof, context.now
                )
                if isinstance(message, Command) and not isinstance(message, Keepalive):
                    for unit in self._units.told(message):
                        T_world_mrf = unit.T_world_mrf
                        if T_world_mrf is not None:
                            unit.commands.take(message, context.now.time_s, T_world_mrf)
        except Refused as refused:
            self._events.refused("command", queued.topic.key, refused.reason, refused.detail)

    def _news(self, queued: QueuedMessage, context: RequestContext) -> None:
        tick = context.now.tick
        try:
            with refusing_errors:
                news = self._admission.admit(queued.topic, queued.payload, None, context.now)
                if isinstance(news, Sighting):
                    self._units.seeing(news.camera).perception.vision.take(news, tick)
                elif isinstance(news, ObstacleNews):
                    self._units.obstacles.take(news, tick, queued.sender)
                elif isinstance(news, ContourNews):
                    self._units.ahead().look_ahead(news, tick)
                elif isinstance(news, FrameNews):
                    self._units.take_frame(news, tick)
        except Refused as refused:
            unread = isinstance(refused.reason, Reason) or refused.reason is Why.HANDLER_RAISED
            if unread and queued.topic.message is ObstacleNews:
                name = text_field(queued.topic, queued.payload, "name")
                self._units.obstacles.doubt(name, tick, f"told of, and {refused.reason}")
            self._events.refused("command", queued.topic.key, refused.reason, refused.detail)

    def _answer(self, refusal: Refusal, context: RequestContext) -> None:
        """Tell of messages that were refused before they were read, and answer the first ones."""
        key, refused = refusal.topic.key, refusal.refused
        kind = "request" if refusal.topic.flow is Flow.REQUEST else "command"
        self._events.refused(kind, key, refused.reason, refused.detail, refusal.count)
        for answer in refusal.answers:
            answer(encode(refusal_reply(refused, context.now)))


def _tell_dropped(unit: Unit | JointUnit) -> None:
    """Tell of goals that ended because something else was asked for."""
    for what, key in unit.commands.dropped:
        unit.events.info(f"{what}_dropped", f"by {key}", by=key)
    unit.commands.dropped.clear()


def _look_at_energy(reflector: Reflector, events: Events) -> None:
    if reflector.take_trip():
        held = ": the force is held back" if reflector.protected else ""
        events.warning(
            "reflection_energy",
            "the handle gives the hand energy that it never got" + held,
            ledger_j=round(reflector.ledger, 4),
            protected=reflector.protected,
        )
