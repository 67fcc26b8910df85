"""Dispatcher: answers the requests of one period, admits commands and puts them in force."""

from ...protocols.codec import encode
from ...protocols.messages.messages import Command, Keepalive
from ...protocols.messages.moving import FrameNews
from ...protocols.messages.obstacles import ObstacleNews
from ...protocols.messages.sightings import Sighting
from ...protocols.topics import Flow
from ..commands.commands import Commands
from ..control.spatial import Pose
from ..refusals import Refused
from ..runtime.events import Events
from .admission import Admission, Instant
from .inbox import Inbox, QueuedMessage, Refusal, refusal_reply
from .request_context import RequestContext
from .services import Services


class Dispatcher:
    """Hands received messages to services, lease, commands and perception."""

    def __init__(
        self,
        inbox: Inbox,
        admission: Admission,
        services: Services,
        commands: Commands,
        events: Events,
    ) -> None:
        self._inbox = inbox
        self._admission = admission
        self._services = services
        self._commands = commands
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
        T_world_mrf = context.placed(self._commands.frames.T_wrist_mrf)
        for queued in self._inbox.commands():
            self._command(queued, context, T_world_mrf)
        for queued in self._inbox.sensors():
            self._news(queued, context)
        for refusal in self._inbox.refusals():
            self._answer(refusal, context)
        self._tell_dropped()
        context.vision.update(context.now.tick)
        context.obstacles.update(context.now.tick)
        self._look_at_energy()
        for name in self._commands.expired(now_s):
            self._events.info("stream_expired", name)

    def listen(self, now: Instant) -> None:
        """Sort what has come while nothing else is due."""
        self._inbox.sort(now)

    @property
    def pressed(self) -> bool:
        """True while so much junk comes in that it should be sorted more often."""
        return self._inbox.pressed

    def _command(
        self, queued: QueuedMessage, context: RequestContext, T_world_mrf: Pose | None
    ) -> None:
        try:
            message = self._admission.admit(queued.topic, queued.payload, queued.proof, context.now)
            if isinstance(message, Keepalive):
                self._admission.renew(context.now)
            elif isinstance(message, Command) and T_world_mrf is not None:
                self._commands.take(message, context.now.time_s, T_world_mrf)
        except Refused as refused:
            self._events.refused("command", queued.topic.key, refused.reason, refused.detail)

    def _news(self, queued: QueuedMessage, context: RequestContext) -> None:
        try:
            news = self._admission.admit(queued.topic, queued.payload, None, context.now)
            if isinstance(news, Sighting):
                context.vision.take(news, context.now.tick)
            elif isinstance(news, ObstacleNews):
                context.obstacles.take(news, context.now.tick)
            elif isinstance(news, FrameNews):
                context.moving_frames.take(news, context.now.tick)
        except Refused as refused:
            self._events.refused("command", queued.topic.key, refused.reason, refused.detail)

    def _answer(self, refusal: Refusal, context: RequestContext) -> None:
        """Tell of messages that were refused before they were read, and answer the first ones."""
        key, refused = refusal.topic.key, refusal.refused
        kind = "request" if refusal.topic.flow is Flow.REQUEST else "command"
        self._events.refused(kind, key, refused.reason, refused.detail, refusal.count)
        for answer in refusal.answers:
            answer(encode(refusal_reply(refused, context.now)))

    def _tell_dropped(self) -> None:
        """Tell of goals that ended because something else was asked for."""
        for what, key in self._commands.dropped:
            self._events.info(f"{what}_dropped", f"by {key}", by=key)
        self._commands.dropped.clear()

    def _look_at_energy(self) -> None:
        reflector = self._commands.handle.reflector
        if reflector is not None and reflector.take_trip():
            held = ": the force is held back" if reflector.protected else ""
            self._events.warning(
                "reflection_energy",
                "the handle gives the hand energy that it never got" + held,
                ledger_j=round(reflector.ledger, 4),
                protected=reflector.protected,
            )
