"""The operators' desk: answers every request, now or once what was asked for has come about.

Requests change the lease, wishes for a mode, and settings. A request for a mode is answered when
the mode is reached, or can't be.
"""

from collections.abc import Callable
from dataclasses import dataclass

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
from ..control.spatial import Array, Pose
from ..mode import Mode, Wish
from ..perception.cameras import VisionTracker
from ..perception.moving_frames import FrameTracker
from ..perception.obstacle_map import ObstacleMap
from ..refusals import Refused, Why
from ..runtime.events import Events
from .admission import Admission, Instant
from .grants import Grants
from .inbox import QueuedMessage, refusal_reply
from .protective import ProtectiveStops

ENABLE_TIMEOUT_S = 3.0
"""Drives that are not in Operation enabled by then will not be [s]."""

_ENDS = {
    Wish.ENABLE: frozenset(Mode) - {Mode.READY},
    Wish.DISABLE: {Mode.FAULT},
    Wish.RESET: frozenset[Mode](),
}
"""Modes in which a wish cannot come about any more."""

_PAST = {"pause": "paused", "resume": "resumed", "abort": "aborted"}


@dataclass(frozen=True)
class RequestContext:
    """What a request may depend on."""

    now: Instant
    mode: Mode
    unloaded: Array | None
    """Sensor reading less the payload's weight, averaged (6,) [N, N·m]; None when stale."""
    still: bool
    """The arm stood while that was averaged, and nothing else was asked of it."""
    essential_stale: tuple[str, ...]
    gain_bound: Callable[[str, tuple[float, ...]], str | None]
    """Why a source's gains would be unstable, or None."""
    vision: VisionTracker
    """What the cameras see."""
    obstacles: ObstacleMap
    """What is known of obstacles."""
    moving_frames: FrameTracker
    """Where the frames are that may move."""
    T_world_mrf: Pose | None = None
    """Where the command has the MRF; None before the joints were heard."""
    T_wrist_mrf: Pose | None = None
    """The MRF that this is; None: the one that is in force."""
    touched: bool = False
    """True while something unseen pushes the arm, which stopped for it."""
    drives_off: bool = True
    """All drives have said that they are off, after what they were last told."""

    def placed(self, T_wrist_mrf: Pose) -> Pose | None:
        """Return where the command has an MRF that may be a new one since; None: nowhere yet."""
        T, then = self.T_world_mrf, self.T_wrist_mrf
        if T is None or then is None or then is T_wrist_mrf:
            return T
        return T @ (then.inverse() @ T_wrist_mrf)


@dataclass(frozen=True)
class _Pending:
    """A wish whose request waits for its answer."""

    asked: QueuedMessage
    since_s: float


class Services:
    """Takes requests, keeps wishes, and remembers the protective stop."""

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
        self.wish = Wish.NONE
        self.hold = False
        self.resume = False
        self._stops = ProtectiveStops()
        self._pending: _Pending | None = None

    @property
    def protective_stop(self) -> str | None:
        """Name of the operator who asked for the protective stop that is latched, if any."""
        return self._stops.asked_by

    def begin_tick(self) -> None:
        """Forget what was asked for one tick only."""
        self.hold = self.resume = False

    def serve(self, asked: QueuedMessage, context: RequestContext) -> None:
        """Answer one request, or keep it until its wish has come about."""
        try:
            message = self._admission.admit(asked.topic, asked.payload, asked.proof, context.now)
            reply = self._act(message, asked, context)
        except Refused as refused:
            self._events.refused("request", asked.topic.key, refused.reason, refused.detail)
            reply = refusal_reply(refused, context.now)
        if reply is not None:
            asked.reply(encode(reply))

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
                return self._mode(message, asked, context)
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
            case StoreView():
                stored = context.vision.store(message.camera)
                self._events.info("view_stored", message.camera or "", **stored)
            case _:
                raise Refused(Why.NOT_NOW, f"no service for {asked.topic.key}")
        return ok

    def _mode(
        self, message: requests.ModeRequest, asked: QueuedMessage, context: RequestContext
    ) -> requests.Reply | None:
        mode = context.mode
        allowed: dict[str, tuple[Mode, ...]] = {
            "enable": (Mode.READY, Mode.HOLD),
            "hold": (Mode.ENABLED, Mode.STOPPING, Mode.HOLD),
            "resume": (Mode.HOLD,),
            "disable": (Mode.ENABLED, Mode.STOPPING, Mode.HOLD),
            "reset": (Mode.FAULT,),
        }
        replaced = (self.wish, message.action) if mode is Mode.READY else None
        if replaced == (Wish.ENABLE, "disable"):
            self.end_enable(context.now, "disable asked")
        elif mode not in allowed[message.action]:
            modes = " or ".join(allowed[message.action])
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
        if self.protective_stop is not None:
            raise Refused(
                Why.PROTECTIVE_STOP, f"protective stop asked by {self.protective_stop} is latched"
            )
        if context.essential_stale:
            raise Refused(Why.SENSOR_STALE, f"{', '.join(context.essential_stale)} is stale")
        if self._commands.settings.avoid and context.obstacles.stop is not None:
            stale = context.obstacles.stop
            raise Refused(Why.SENSOR_STALE, f"the news of obstacle {stale} is stale")
        if context.touched:
            raise Refused(Why.TOUCHED, "what pushes the arm is still there")

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
