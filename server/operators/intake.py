"""What operators say in one period: requests answered, commands admitted and put in force."""

from ...protocols.codec import encode
from ...protocols.messages.messages import Command, Keepalive
from ...protocols.messages.moving import FrameNews
from ...protocols.messages.obstacles import ObstacleNews
from ...protocols.messages.sightings import Sighting
from ...protocols.topics import Flow
from ..commands.commands import Orders
from ..control.spatial import Pose
from ..refusals import Refused
from ..runtime.events import Events
from .admission import Admission, Now
from .inbox import Letter, Reception, Refusal, refusal_reply
from .services import Desk, View


class Intake:
    """Takes what was received and hands it to the desk, the lease or the orders."""

    def __init__(
        self,
        reception: Reception,
        admission: Admission,
        desk: Desk,
        orders: Orders,
        events: Events,
    ) -> None:
        self._reception = reception
        self._admission = admission
        self._desk = desk
        self._orders = orders
        self._events = events

    def take(self, view: View) -> None:
        """Take what has come."""
        now_s = view.now.time_s
        self._desk.begin_tick()
        holder = self._admission.lease.holder
        if holder is not None and not self._admission.lease.alive(now_s):
            self._events.warning("lease_expired", holder)
            self._admission.end()
        self._reception.sort(view.now)
        for refusal in self._reception.refusals():
            self._answer(refusal, view)
        for asked in self._reception.requests():
            self._desk.serve(asked, view)
        T_world_mrf = view.placed(self._orders.places.T_wrist_mrf)
        for letter in self._reception.commands():
            self._command(letter, view, T_world_mrf)
        for letter in self._reception.sensors():
            self._news(letter, view)
        for refusal in self._reception.refusals():
            self._answer(refusal, view)
        self._tell_dropped()
        view.vision.look(view.now.tick)
        view.world.look(view.now.tick)
        self._look_at_energy()
        for name in self._orders.expired(now_s):
            self._events.info("stream_expired", name)

    def listen(self, now: Now) -> None:
        """Sort what has come while nothing else is due."""
        self._reception.sort(now)

    @property
    def pressed(self) -> bool:
        """True while so much junk comes in that it should be sorted more often."""
        return self._reception.pressed

    def _command(self, letter: Letter, view: View, T_world_mrf: Pose | None) -> None:
        try:
            message = self._admission.admit(letter.topic, letter.payload, letter.proof, view.now)
            if isinstance(message, Keepalive):
                self._admission.renew(view.now)
            elif isinstance(message, Command) and T_world_mrf is not None:
                self._orders.take(message, view.now.time_s, T_world_mrf)
        except Refused as refused:
            self._events.refused("command", letter.topic.key, refused.reason, refused.detail)

    def _news(self, letter: Letter, view: View) -> None:
        try:
            news = self._admission.admit(letter.topic, letter.payload, None, view.now)
            if isinstance(news, Sighting):
                view.vision.take(news, view.now.tick)
            elif isinstance(news, ObstacleNews):
                view.world.take(news, view.now.tick)
            elif isinstance(news, FrameNews):
                view.frames.take(news, view.now.tick)
        except Refused as refused:
            self._events.refused("command", letter.topic.key, refused.reason, refused.detail)

    def _answer(self, refusal: Refusal, view: View) -> None:
        """Tell of messages that were refused before they were read, and answer the first ones."""
        key, refused = refusal.topic.key, refusal.refused
        kind = "request" if refusal.topic.flow is Flow.REQUEST else "command"
        self._events.refused(kind, key, refused.reason, refused.detail, refusal.count)
        for answer in refusal.answers:
            answer(encode(refusal_reply(refused, view.now)))

    def _tell_dropped(self) -> None:
        """Tell of goals that ended because something else was asked for."""
        for what, key in self._orders.dropped:
            self._events.info(f"{what}_dropped", f"by {key}", by=key)
        self._orders.dropped.clear()

    def _look_at_energy(self) -> None:
        reflector = self._orders.reflector
        if reflector is not None and reflector.take_trip():
            held = ": the force is held back" if reflector.protected else ""
            self._events.warning(
                "reflection_energy",
                "the handle gives the hand energy that it never got" + held,
                ledger_j=round(reflector.ledger, 4),
                protected=reflector.protected,
            )
