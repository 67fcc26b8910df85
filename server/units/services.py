"""Requests that concern one arm or its task: settings, frames, loads, paths, views."""

import numpy as np

from ...protocols.messages import messages as m
from ...protocols.messages import motion, requests
from ...protocols.messages.perception.moving import FrameRequest
from ...protocols.messages.perception.sightings import StoreView
from ...protocols.messages.reflection import ReflectionRequest
from ..refusals import Refused, Why
from .joint_unit import JointUnit
from .unit import Unit

_PAST = {"pause": "paused", "resume": "resumed", "abort": "aborted"}


def serve_unit(message: m.Message, unit: Unit | JointUnit) -> None:
    """Do what a request asks of a unit, and tell it by an event. Raises `Refused`."""
    commands, events = unit.commands, unit.events
    settings = commands.settings
    match message:
        case requests.GainRequest():
            _set_gain(message, unit)
        case requests.SwitchRequest():
            settings.require_source(message.source)
            if message.on and message.source == "vision":
                unit.vision.require_view()
            settings.switch(message.source, message.on)
            commands.goals.idle = commands.goals.idle and not message.on
            if message.on and message.source == "position":
                commands.goals.restart_path()
            events.info("source_switched", message.source, on=message.on)
        case FrameRequest():
            T_world_mrf = unit.T_world_mrf
            if T_world_mrf is None:
                raise Refused(Why.NOT_NOW, "where the arm is was not heard yet")
            commands.set_frame(message, T_world_mrf)
            _tell_frame(message, unit)
        case requests.PayloadRequest():
            settings.set_payload(message, unit.perception.weighed)
            if not message.unknown:
                _tell_payload(message.name, unit)
        case requests.GripperRequest():
            settings.set_gripper(message.closed)
            events.info("gripper_closed" if message.closed else "gripper_opened")
        case motion.RedundancyRequest():
            settings.set_objective(message)
            commands.goals.idle = False
            events.info("objective_set", message.objective, gain=message.gain)
        case motion.ClutchRequest():
            commands.set_clutch(message)
            master = commands.master
            events.info(
                "clutch_set",
                "",
                engaged=master.engaged,
                translation=master.translation,
                rotation=master.rotation,
            )
        case ReflectionRequest():
            commands.handle.set_protection(message)
            tell = events.info if message.protected else events.warning
            tell("reflection_protected" if message.protected else "reflection_unprotected")
        case motion.PathRequest():
            commands.goals.control_path(message)
            events.info("path_" + _PAST[message.action])
        case requests.TareRequest():
            _tare(unit)
        case requests.AcknowledgeLoad():
            settings.hear_of_load("acknowledged")
        case StoreView():
            stored = unit.look_through(message.camera).store(message.camera)
            events.info("view_stored", message.camera or "", **stored)
        case _:
            raise Refused(Why.NOT_NOW, f"no service for {type(message).__name__}")


def _set_gain(message: requests.GainRequest, unit: Unit | JointUnit) -> None:
    reason = unit.commands.settings.set_gain(message.source, message.gain, message.forced)
    if reason is not None:
        unit.events.warning("gain_forced", reason, source=message.source)
    unit.events.info("gain_set", message.source, gain=str(list(message.gain)))


def _tell_frame(request: FrameRequest, unit: Unit | JointUnit) -> None:
    there = request.relative_to or ("wrist" if request.frame == "mrf" else "world")
    on = {"moves_with": unit.commands.frames.crf.on} if request.frame == "crf" else {}
    unit.events.info("frame_set", request.frame, relative_to=str(there), **on)


def _tell_payload(name: str | None, unit: Unit | JointUnit) -> None:
    payload = unit.commands.settings.payload
    if payload is not None:
        com = str(np.round(payload.com, 4).tolist())
        unit.events.info("payload_set", name or "", mass=payload.mass, com=com)


def _tare(unit: Unit | JointUnit) -> None:
    sensor = unit.perception.sensor
    if sensor.unloaded is None:
        raise Refused(Why.SENSOR_STALE, "force_torque is stale or missing")
    if not sensor.still:
        raise Refused(Why.NOT_NOW, "the arm moves, or is told to")
    unit.commands.settings.tare(sensor.unloaded)
    unit.events.info("tared", "", bias=str(np.round(sensor.unloaded, 3).tolist()))
