"""Services: the answer to every request, which changes the lease, the mode or settings."""

import numpy as np

from ...protocols.codec import encode
from ...protocols.messages import messages as m
from ...protocols.messages import motion, requests
from ...protocols.messages.moving import FrameRequest
from ...protocols.messages.obstacles import AvoidanceRequest
from ...protocols.messages.reflection import ReflectionRequest
from ...protocols.messages.sightings import StoreView
from ...protocols.proof import Proof
from ..commands.commands import Commands
from ..refusals import Refused, Why
from ..runtime.events import Events
from .admission import Admission, Grants
from .inbox import QueuedMessage, refusal_reply
from .mode_requests import ModeRequests
from .protective import ProtectiveStops
from .request_context import RequestContext

_PAST = {"pause": "paused", "resume": "resumed", "abort": "aborted"}


class Services:
    """Answers requests; keeps the protective stops, and requests for a mode that wait."""

    def __init__(
        self,
        admission: Admission,
        commands: Commands,
        events: Events,
        grants: Grants,
    ) -> None:
        self._admission = admission
        self._commands = commands
        self._events = events
        self._grants = grants
        self._stops = ProtectiveStops()
        self.modes = ModeRequests(commands.settings, self._stops, events)

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
            case requests.GainRequest():
                self._commands.settings.require_source(message.source)
                reason = context.gain_bound(message.source, message.gain)
                reason = reason or self._commands.settings.gain_refusal(
                    message.source, message.gain
                )
                if reason is not None:
                    if not message.forced:
                        raise Refused(Why.UNSTABLE_GAIN, reason)
                    self._events.warning("gain_forced", reason, source=message.source)
                self._commands.settings.gains[message.source] = np.array(message.gain)
                self._events.info("gain_set", message.source, gain=str(list(message.gain)))
            case requests.SwitchRequest():
                self._commands.settings.require_source(message.source)
                if message.on and message.source == "vision":
                    context.vision.require_view()
                self._commands.settings.switch(message.source, message.on)
                self._commands.goals.idle = self._commands.goals.idle and not message.on
                if message.on and message.source == "position":
                    self._commands.goals.restart_path()
                self._events.info("source_switched", message.source, on=message.on)
            case FrameRequest():
                T_world_mrf = context.placed(self._commands.frames.T_wrist_mrf)
                if T_world_mrf is None:
                    raise Refused(Why.NOT_NOW, "where the arm is was not heard yet")
                self._commands.set_frame(message, T_world_mrf)
                self._tell_frame(message)
            case requests.SpeedRequest():
                self._commands.settings.speed_factor = message.factor
                self._events.info("speed_set", "", factor=message.factor)
            case requests.PayloadRequest():
                self._commands.settings.set_payload(message)
                if not message.unknown:
                    self._tell_payload(message.name)
            case requests.GripperRequest():
                self._commands.settings.set_gripper(message.closed)
                self._events.info("gripper_closed" if message.closed else "gripper_opened")
            case motion.RedundancyRequest():
                self._commands.settings.set_objective(message)
                self._commands.goals.idle = False
                self._events.info("objective_set", message.objective, gain=message.gain)
            case motion.ClutchRequest():
                self._commands.set_clutch(message)
                master = self._commands.master
                self._events.info(
                    "clutch_set",
                    "",
                    engaged=master.engaged,
                    translation=master.translation,
                    rotation=master.rotation,
                )
            case ReflectionRequest():
                self._commands.handle.set_protection(message)
                tell = self._events.info if message.protected else self._events.warning
                tell("reflection_protected" if message.protected else "reflection_unprotected")
            case motion.PathRequest():
                self._commands.goals.control_path(message)
                self._events.info("path_" + _PAST[message.action])
            case AvoidanceRequest():
                if message.on and not self._commands.settings.can_avoid:
                    raise Refused(Why.NOT_NOW, "the cell says nothing of avoidance")
                self._commands.settings.avoid = message.on
                self._events.info("avoidance_switched", "", on=message.on)
            case requests.TareRequest():
                self._tare(context)
            case requests.AcknowledgeLoad():
                self._commands.settings.hear_of_load("acknowledged")
            case requests.MarkRequest():
                self._events.info("marked", message.text)
            case StoreView():
                stored = context.vision.store(message.camera)
                self._events.info("view_stored", message.camera or "", **stored)
            case _:
                raise Refused(Why.NOT_NOW, f"no service for {asked.topic.key}")
        return ok

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

    def _tell_frame(self, request: FrameRequest) -> None:
        there = request.relative_to or ("wrist" if request.frame == "mrf" else "world")
        on = {"moves_with": self._commands.frames.crf.on} if request.frame == "crf" else {}
        self._events.info("frame_set", request.frame, relative_to=str(there), **on)

    def _tell_payload(self, name: str | None) -> None:
        payload = self._commands.settings.payload
        if payload is not None:
            com = str(np.round(payload.com, 4).tolist())
            self._events.info("payload_set", name or "", mass=payload.mass, com=com)

    def _tare(self, context: RequestContext) -> None:
        if context.unloaded is None:
            raise Refused(Why.SENSOR_STALE, "force_torque is stale or missing")
        if not context.still:
            raise Refused(Why.NOT_NOW, "the arm moves, or is told to")
        self._commands.settings.tare(context.unloaded)
        self._events.info("tared", "", bias=str(np.round(context.unloaded, 3).tolist()))
