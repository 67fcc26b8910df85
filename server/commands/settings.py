"""Settings of operators: gains, switches, payload, gripper, objectives, reduced speed."""

from collections.abc import Callable
from dataclasses import dataclass
from operator import is_
from typing import Any, Self

import numpy as np
from pydantic import ValidationError

from ...config.schema.cell import CellConfig
from ...config.schema.null_space import OBJECTIVES, ObjectivesSection
from ...protocols.messages import requests
from ...protocols.messages.messages import RedundancyRequest, VirtualLinksRequest
from ..control.axes import holding
from ..control.inputs import ObjectiveGains, Payload, Settings, ToldTunnel, VirtualLinks
from ..control.spatial import Array, Pose
from ..refusals import Refused, Why
from ..stability.judgement import WRENCH_SOURCES, LoopBounds, Verdict
from ..stability.loops import GainVector
from .frames import FrameSet

OFF = np.zeros(6)
"""Gain (6,) of a source that is switched off."""


@dataclass
class CellSettings:
    """Settings that all arms of a cell share."""

    speed_factor: float
    avoid: bool
    """Clearances are kept."""
    can_avoid: bool

    @classmethod
    def from_config(cls, config: CellConfig) -> Self:
        """Return those of a cell file."""
        return cls(config.limits.speed_factor, config.avoidance.enabled, config.keeps_clear)


class OperatorSettings:
    """The settings in force for one arm with its frames; at first those of the cell file."""

    def __init__(
        self, config: CellConfig, bounds: LoopBounds, shared: CellSettings, frames: FrameSet
    ) -> None:
        self._shared, self._frames, self.bounds = shared, frames, bounds
        sources = config.sources
        self._postures = {k: np.array(q) for k, q in config.mechanism.postures.items()}
        sensor = config.mechanism.force_torque
        there = {
            "camera": bool(config.cameras),
            "force_torque": sensor is not None,
            "contour": config.contour is not None,
        }
        self.gains = {name: np.array(section.gain) for name, section in sources.each.items()}
        self.on = {
            name: section.enabled and there.get(section.NEEDS or "", True)
            for name, section in sources.each.items()
        }
        self._vision_on = self.on["vision"]
        redundancy = config.redundancy
        self.objectives = ObjectiveGains(redundancy.gains, self._postures[redundancy.posture_name])
        self.held = holding(config.resolve.free_axes)
        """Axes of the MRF (6,) that the task holds: 1 held, 0 free; None: all are held."""
        self.tunnel: ToldTunnel | None = None
        """What an operator told of the arm's tunnel; None: the cell's is in force."""
        self.shares: Array | None = None
        """Diagonals of W (k, 6) that an operator told a joint task; None: the cell's are in force.
        """
        self._own_links = config.potential.virtual_link
        self.links = None if self._own_links is None else VirtualLinks.of(self._own_links)
        """Along which the tool may leave its path; None in a cell without any."""
        self.wrench_bias = np.zeros(6) if sensor is None else -np.array(sensor.bias)
        self.T_wrist_sensor = None
        """None without a sensor."""
        self.payload = None
        """Payload on the sensor; None without a sensor."""
        if sensor is not None:
            place = sensor.T_wrist_sensor
            self.T_wrist_sensor = Pose.from_xyz_rpy(place.xyz, place.rpy)
            self.payload = Payload(sensor.payload.mass, np.array(sensor.payload.com))
        self._payloads = {
            name: Payload(p.mass, np.array(p.com)) for name, p in config.mechanism.payloads.items()
        }
        self.load_told, self.load_heard = 0, ""
        """Number of requests about the load, and the kind of the last one."""
        self.sensor_share = 1.0
        """Part of their gains that the sources of the force/torque sensor act with [1]."""
        self.contact_share = 1.0
        """Part of the task's sum that acts: less on what force control rang on [1]."""
        self.untold: Array | None = None
        """Wrench (6,) at the MRF, in World axes, that leads nobody's hand; None without one."""
        self.load_settles = False
        """The load was told anew while nothing was measured: they wait until that is in effect."""
        self._rated_payload = config.mechanism.rated_payload
        self._gripper = config.mechanism.gripper
        self.gripper_closed: bool | None = None
        """None until an operator has said so: what it held at start stays held."""
        self._made_of: tuple[object, ...] = (None,)
        self._made: Settings
        """What a tick used last, and what that was made of."""
        self._forced: set[str] = set()
        """Sources whose gains were forced: an operator answers for them."""

    def for_control(self) -> Settings:
        """Return the settings that a tick uses, with the frames in force.

        They are the same object until something that they are made of is another one.
        """
        frames, shared = self._frames, self._shared
        at_once = WRENCH_SOURCES if self.load_settles else ()
        made_of: dict[str, Any] = {
            "T_wrist_mrf": frames.T_wrist_mrf,
            "T_world_crf": frames.T_world_crf,
            "redefined": frames.redefined,
            "wrench_bias": self.wrench_bias,
            "speed_factor": shared.speed_factor,
            "payload": self.payload,
            "objectives": self.objectives,
            "avoid": shared.avoid,
            "at_once": at_once,
            "contact_share": self.contact_share,
            "untold": self.untold,
            "held": self.held,
            "tunnel": self.tunnel,
            "shares": self.shares,
            "links": self.links,
        }
        now = (*made_of.values(), *self.gains.values(), *self.on.values(), self.sensor_share)
        if not all(map(is_, now, self._made_of)):
            gains = self._gains_on
            if self.sensor_share < 1.0:
                gains.update({name: self.sensor_share * gains[name] for name in WRENCH_SOURCES})
            self._made_of, self._made = now, Settings(gains=gains, **made_of)
        return self._made

    @property
    def _gains_on(self) -> dict[str, Array]:
        """The sources' gains (6,), waiting for a load or not: zero for one that is off."""
        return {name: gain if self.on[name] else OFF for name, gain in self.gains.items()}

    def hear_of_load(self, what: str) -> None:
        """Count a request about the load, so that `LoadMonitor` judges it anew."""
        self.load_told, self.load_heard = self.load_told + 1, what

    def posture(self, name: str) -> Array:
        """Return a posture (n,) [rad] of the cell by its name. Raises `Refused`."""
        if name not in self._postures:
            raise Refused(Why.UNKNOWN_POSTURE, f"{name!r} is none of {', '.join(self._postures)}")
        return self._postures[name]

    def settle_vision(self) -> None:
        """Put the vision source's switch back to what it was at start."""
        self.on["vision"] = self._vision_on

    def require_source(self, source: str) -> None:
        """Raise `Refused` for a source that there is not."""
        if source not in self.gains:
            known = ", ".join(self.gains)
            raise Refused(Why.UNKNOWN_SOURCE, f"{source!r} is none of {known}")

    def set_objective(self, request: RedundancyRequest) -> None:
        """Set a redundancy objective's gain.

        Raises `Refused` for an objective or a posture that there is not, and for a gain that the
        cell file may not have.
        """
        name = request.objective
        if name not in OBJECTIVES:
            known = ", ".join(OBJECTIVES)
            raise Refused(Why.UNKNOWN_OBJECTIVE, f"{name!r} is none of {known}")
        try:
            ObjectivesSection.model_validate({name: request.gain})
        except ValidationError as error:
            complaint = error.errors()[0]["msg"]
            raise Refused(Why.OUT_OF_RANGE, f"{name}: gain {request.gain:g}: {complaint}") from None
        q = self.objectives.posture if request.posture is None else self.posture(request.posture)
        self.objectives = ObjectiveGains({**self.objectives.gains, name: request.gain}, q)

    def set_links(self, request: VirtualLinksRequest) -> None:
        """Set the virtual links.

        Raises `Refused` in a cell without any, and for what the cell file may not have.
        """
        own, now = self._own_links, self.links
        if own is None or now is None:
            raise Refused(Why.NOT_NOW, "the cell has no [potential.virtual_link]")
        given = request.model_dump(include=set(VirtualLinks._fields), exclude_none=True)
        told = (VirtualLinks.of(own) if request.reset else now)._replace(**given)
        if told.directions:
            try:
                type(own).model_validate({**own.model_dump(), **told._asdict()})
            except ValidationError as error:
                complaint = error.errors()[0]["msg"].removeprefix("Value error, ")
                raise Refused(Why.OUT_OF_RANGE, f"virtual link: {complaint}") from None
        self.links = told

    def set_payload(
        self, request: requests.PayloadRequest, weighed: Callable[[Payload], bool] | None = None
    ) -> None:
        """Redefine what hangs on the sensor; `weighed` tells whether the sensor reads a payload.

        Raises `Refused` for a name that the cell lacks, and for what would swing the tool.
        """
        if self.payload is None:
            raise Refused(Why.NOT_NOW, "the cell has no force/torque sensor")
        if request.unknown:
            self.hear_of_load("unknown")
            return
        rated = self._rated_payload
        if rated is not None and (request.mass or 0.0) > rated:
            raise Refused(Why.OUT_OF_RANGE, f"mass: {request.mass:g} kg, rated for {rated:g}")
        if request.name is None:
            payload = Payload(request.mass or 0.0, np.array(request.com))
        elif request.name in self._payloads:
            payload = self._payloads[request.name]
        else:
            known = ", ".join(self._payloads) or "none in this cell"
            raise Refused(Why.UNKNOWN_PAYLOAD, f"{request.name!r} is none of: {known}")
        swings = self.bounds.payloads.inertia.refusal(payload)
        if swings is not None and (weighed is None or not weighed(payload)):
            raise Refused(Why.UNSTABLE_PAYLOAD, swings)
        self._hang(payload)
        if request.bias is not None:
            self.wrench_bias = -np.array(request.bias)
        self.hear_of_load("payload")

    def tare(self, unloaded: Array) -> None:
        """Take a reading (6,) without the payload's weight for that of no contact."""
        self.wrench_bias = unloaded
        self.hear_of_load("tare")

    @property
    def outputs(self) -> dict[str, bool]:
        """Commanded states of the outputs, by name."""
        return {} if self.gripper_closed is None else {"gripper": self.gripper_closed}

    def set_gripper(self, closed: bool) -> None:
        """Close or open the gripper, and switch to the payload that the cell has for that."""
        if self._gripper is None:
            raise Refused(Why.NOT_NOW, "the cell has no gripper")
        name = self._gripper.closed_payload if closed else self._gripper.open_payload
        if name is not None and self.payload is not None:
            self._hang(self._payloads[name])
        self.gripper_closed = closed
        self.hear_of_load("gripper")

    def switch(self, source: str, on: bool) -> None:
        """Switch a source.

        Raises `Refused` where it would swing with the MRF in force, or the payload by it.
        """
        if on and source in WRENCH_SOURCES and self.payload is not None:
            gains = self.gains[source]
            refusal = self._verdict(source, gains, self._frames.T_wrist_mrf).refusal
            if refusal is not None and source not in self._forced:
                raise Refused(Why.UNSTABLE_GAIN, refusal)
            self._judge(self.payload, {**self._gains_on, source: gains})
        self.on[source] = on

    def set_gain(self, source: str, gain: tuple[float, ...], forced: bool) -> str | None:
        """Set a source's gain (6,); return why that is unstable, if it is, and was `forced`.

        Judged with the MRF and the payload in force. Raises `Refused`.
        """
        self.require_source(source)
        reason = self._verdict(source, gain, self._frames.T_wrist_mrf).refusal
        if reason is None and source in WRENCH_SOURCES and self.payload is not None:
            gains = {**self._gains_on, source: np.array(gain)}
            reason = self.bounds.payload(self.payload, gains, self._frames.T_wrist_mrf)
        if reason is not None and not forced:
            raise Refused(Why.UNSTABLE_GAIN, reason)
        (self._forced.discard if reason is None else self._forced.add)(source)
        self.gains[source] = np.array(gain)
        return reason

    def require_mrf(self, T_wrist_mrf: Pose) -> None:
        """Raise `Refused` for a new MRF with which a source that is on would swing the tool.

        Gains that were forced may be as near to their bound as they are now.
        """
        for source in WRENCH_SOURCES:
            if not self.on[source]:
                continue
            found = self._verdict(source, self.gains[source], T_wrist_mrf)
            now = self._verdict(source, self.gains[source], self._frames.T_wrist_mrf)
            if found.refusal is not None and found.share > now.share:
                raise Refused(Why.UNSTABLE_FRAME, f"{source}: {found.refusal}")
        if self.payload is not None:
            reason = self.bounds.payload(self.payload, self._gains_on, T_wrist_mrf)
            at_now = self.bounds.payload(self.payload, self._gains_on, self._frames.T_wrist_mrf)
            if reason is not None and at_now is None:
                raise Refused(Why.UNSTABLE_FRAME, reason)

    def _verdict(self, source: str, gain: GainVector, T_wrist_mrf: Pose) -> Verdict:
        mass = None if self.payload is None else self.payload.mass
        return self.bounds.gain(source, gain, T_wrist_mrf, mass)

    def _hang(self, payload: Payload) -> None:
        self._judge(payload, self._gains_on)
        self.payload = payload

    def _judge(self, payload: Payload, gains: dict[str, Array]) -> None:
        reason = self.bounds.payload(payload, gains, self._frames.T_wrist_mrf)
        if reason is not None:
            raise Refused(Why.UNSTABLE_PAYLOAD, reason)
