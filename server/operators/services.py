"""Services: the answer to every request, which changes the lease, the mode or settings."""

from ...protocols.codec import encode
from ...protocols.messages import messages as m
from ...protocols.messages import requests
from ...protocols.messages.perception.obstacles import AvoidanceRequest
from ...protocols.proof import Proof
from ..refusals import Refused, Why
from ..runtime.events import Events
from ..units.services import serve_unit
from ..units.units import Units
from .admission import Admission, Grants
from .inbox import QueuedMessage, refusal_reply
from .mode_requests import ModeRequests
from .protective import ProtectiveStops
from .request_context import RequestContext


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
        self._stops = ProtectiveStops()
        self.modes = ModeRequests(self._stops, events)

    @property
    def protective_stop(self) -> str | None:
        """Name of the operator who asked for the protective stop that is latched, if any."""
        return self._stops.asked_by

    def serve(self, asked: QueuedMessage, context: RequestContext) -> None:
        """Answer one request, or let one for a mode wait until the mode is reached."""
        try:
            message = self._admission.admit(asked.topic, asked.payload, asked.proof, context.now)
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
                self._stops.latch(message.operator, message.seal)
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
        if self._stops.asked_by is None:
            return requests.Reply(ok=True, tick=context.now.tick)
        if self._admission.holds(proof, context.now):
            self._stops.clear()
        else:
            self._stops.open(message.opens)
        left = self._stops.asked_by
        detail = f"by {message.operator}" + (f"; that of {left} is latched" if left else "")
        self._events.info("protective_stop_cleared", detail)
        return requests.Reply(ok=True, tick=context.now.tick, detail=detail[:500])
