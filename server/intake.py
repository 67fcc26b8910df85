"""What operators say in one period: requests answered, commands admitted and put in force."""

from ..protocols.messages import Command, Keepalive
from ..protocols.moving import FrameNews
from ..protocols.obstacles import ObstacleNews
from ..protocols.sightings import Sighting
from ..protocols.topics import Topic
from .admission import Admission, Refused
from .desk import Desk, View
from .events import Events
from .link import Link
from .orders import Orders


class Intake:
    """Takes everything from the link and hands it to the desk, the lease or the orders."""

    def __init__(
        self, link: Link, admission: Admission, desk: Desk, orders: Orders, events: Events
    ) -> None:
        self._link = link
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
        for asked in self._link.requests():
            self._desk.serve(asked, view)
        commands = self._admitted(view)
        T_world_mrf = view.placed(self._orders.places.T_wrist_mrf)
        if T_world_mrf is not None:
            # Topics arrive apart; what one operator said within a period is taken as it was said.
            for topic, command, _ in sorted(commands, key=lambda item: item[2]):
                try:
                    self._orders.take(command, now_s, T_world_mrf)
                except Refused as refused:
                    self._refuse(topic, refused)
        view.vision.look(view.now.tick)
        view.world.look(view.now.tick)
        self._look_at_energy()
        for name in self._orders.expired(now_s):
            self._events.info("stream_expired", name)

    def _admitted(self, view: View) -> list[tuple[Topic, Command, int]]:
        admitted: list[tuple[Topic, Command, int]] = []
        for topic, payload, attached in self._link.commands():
            try:
                proof = None
                if topic.needs_proof:
                    proof = self._admission.prove(topic, payload, attached, view.now)
                message = self._admission.admit(topic, payload, proof, view.now)
                if isinstance(message, Sighting):
                    view.vision.take(message, view.now.tick)
                elif isinstance(message, ObstacleNews):
                    view.world.take(message, view.now.tick)
                elif isinstance(message, FrameNews):
                    view.frames.take(message, view.now.tick)
            except Refused as refused:
                self._refuse(topic, refused)
                continue
            if isinstance(message, Keepalive):
                self._admission.renew(view.now)
            elif isinstance(message, Command) and proof is not None:
                admitted.append((topic, message, proof.seq))
        return admitted

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

    def _refuse(self, topic: Topic, refused: Refused) -> None:
        self._events.warning(
            "command_refused",
            f"{topic.key}: {refused.detail}",
            topic=topic.key,
            reason=str(refused.reason),
        )
