"""Dispatcher: answers the requests of one period, admits commands and puts them in force."""

from ...protocols.codec import Reason, encode, text_field
from ...protocols.messages.messages import Command, Keepalive
from ...protocols.messages.perception.contour import ContourNews
from ...protocols.messages.perception.moving import FrameNews
from ...protocols.messages.perception.obstacles import ObstacleNews
from ...protocols.messages.perception.sightings import Sighting
from ...protocols.topics import Flow
from ..refusals import Refused
from ..runtime.events import Events
from ..units.joint_unit import JointUnit
from ..units.unit import Unit
from ..units.units import Units
from .admission import Admission, Instant
from .inbox import Inbox, QueuedMessage, Refusal, refusal_reply
from .request_context import RequestContext
from .services import Services


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
        for queued in self._inbox.commands():
            self._command(queued, context)
        for queued in self._inbox.sensors():
            self._news(queued, context)
        for refusal in self._inbox.refusals():
            self._answer(refusal, context)
        self._units.obstacles.update(context.now.tick)
        for unit in self._units.each:
            unit.perception.vision.update(context.now.tick)
            if unit.perception.passage is not None:
                unit.perception.passage.update(context.now.tick)
        for commanded in self._units.all:
            _tell_dropped(commanded)
            _look_at_energy(commanded)
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
            message = self._admission.admit(queued.topic, queued.payload, queued.proof, context.now)
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
            news = self._admission.admit(queued.topic, queued.payload, None, context.now)
            if isinstance(news, Sighting):
                self._units.seeing(news.camera).perception.vision.take(news, tick)
            elif isinstance(news, ObstacleNews):
                self._units.obstacles.take(news, tick, queued.sender)
            elif isinstance(news, ContourNews):
                self._units.ahead().take(news, tick)
            elif isinstance(news, FrameNews):
                for unit in self._units.each:
                    unit.perception.moving_frames.take(news, tick)
        except Refused as refused:
            if queued.topic.message is ObstacleNews and isinstance(refused.reason, Reason):
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


def _look_at_energy(unit: Unit | JointUnit) -> None:
    reflector = unit.commands.handle.reflector
    if reflector is not None and reflector.take_trip():
        held = ": the force is held back" if reflector.protected else ""
        unit.events.warning(
            "reflection_energy",
            "the handle gives the hand energy that it never got" + held,
            ledger_j=round(reflector.ledger, 4),
            protected=reflector.protected,
        )
