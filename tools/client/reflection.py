"""A force-reflecting handle at the operator's side: its loop, and what bounds it."""

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from ...config.schema.network import ReflectionSection
from ...drivers.rig.handle import STEP_S, SimulatedHandle
from ...protocols.messages import messages as m
from ...protocols.messages.messages import Reflection
from ...protocols.messages.telemetry import State
from ...server.reflection import HeldStick, Port, damping
from .protocol_client import RoundTrip

# --- Client of a reflecting handle: the force it feels, the commands it sends, its protection -----
#
# Given what comes in and the time, as a `ProtocolClient`; the same in virtual and in real time.
Mode = Literal["rate", "pose"]

HANDLE_RESERVE = 0.1
"""Part of the energy bound that may leave the handle's port before anything has entered [1]."""

MOST_DAMPING = 0.1
"""Damping that the port injects, at most, as a part of mass / step: more of it would ring [1]."""

SILENCE_S = 0.3  # without news for this long, the force fades [s]
FADE_S = 0.3  # it has faded within this; then nothing is sent any more [s]

CALM_S = 2.0  # a longest round trip is forgotten with this time constant [s]

LONGEST_LAPSE_S = 0.25  # after a longer lapse the device's time goes on without making it up [s]


class ReflectingClient:
    """One handle, and the protection of its loop."""

    def __init__(self, config: ReflectionSection, now_s: float) -> None:
        self._config = config
        self.device = SimulatedHandle(config.handle, config.hand)
        self.trip = RoundTrip()
        self.mode: Mode = "rate"
        self.axes = m.Frame.CRF
        self.port = Port()
        """The handle's port: what the hand put into the network, and got out of it."""
        self._now_s = now_s
        self._news: Reflection | None = None
        self._news_s = now_s
        self._far = 0.0
        self._slowest_s: float | None = None
        self._filtered = np.zeros(6)
        self._share = 0.0
        self._stick = HeldStick.of(config.handle, config.hand)

    def set_mode(self, mode: Mode, axes: m.Frame) -> None:
        """Be a stick on a spring, or a free handle whose pose leads; `axes` are what it lies in."""
        self.mode, self.axes = mode, axes
        self.device.spring = mode == "rate"

    # --- what comes in ------------------------------------------------------------------------

    def on_state(self, state: State, now_s: float) -> None:
        before = self.trip.heard_s
        self.trip.echoed(state.last_seq, now_s)
        newest = self.trip.seconds
        if newest is None or self.trip.heard_s == before:
            return
        kept = 0.0 if self._slowest_s is None or before is None else self._slowest_s
        if before is not None:
            kept = newest + (kept - newest) * math.exp((before - now_s) / CALM_S)
        self._slowest_s = max(newest, kept)

    def on_reflection(self, news: Reflection, now_s: float) -> None:
        """Take in what the arm feels; what was overtaken is old."""
        if self._news is None or news.tick > self._news.tick:
            if self._news is None or news.entered < self._news.entered:
                self._far -= news.entered  # a daemon that counts anew: from here
            else:
                self._far += news.entered - self._news.entered
            self._far = max(0.0, self._far)
            self._news, self._news_s = news, now_s

    @property
    def round_trip_s(self) -> float:
        """The longest round trip of late; the longest expected before one was seen [s]."""
        return self._config.largest_round_trip_s if self._slowest_s is None else self._slowest_s

    @property
    def silent(self) -> bool:
        """True when there was no news for so long that the force has faded."""
        return self._now_s - self._news_s > SILENCE_S and self._share <= 0.0

    @property
    def filter_s(self) -> float:
        """Time constant of the low-pass on what is reflected now [s]."""
        if self._news is None or not self._news.protected or self.mode == "pose":
            return 0.0
        gain = self._news.slope * self._stick.rate_per_force
        return self._stick.filter_s(gain, self.round_trip_s)

    # --- what goes on -------------------------------------------------------------------------

    def run(self, now_s: float) -> None:
        """Let handle and hand move on to now."""
        if now_s - self._now_s > LONGEST_LAPSE_S:
            self._now_s = now_s - STEP_S
        filter_s = self.filter_s
        part = 1.0 if filter_s <= 0.0 else 1.0 - math.exp(-STEP_S / filter_s)
        while self._now_s + STEP_S <= now_s + 1e-9:
            self._now_s += STEP_S
            self._step(part)

    def _step(self, part: float) -> None:
        fading = self._news is None or self._now_s - self._news_s > SILENCE_S
        way = (0.0 if fading else 1.0) - self._share
        self._share += math.copysign(min(abs(way), STEP_S / FADE_S), way)
        device, news = self.device, self._news
        wrench = np.zeros(6) if news is None else np.array(news.wrench)
        self._filtered = self._filtered + part * (wrench - self._filtered)
        injected = np.zeros(3)
        if self.mode == "pose" and news is not None and news.protected:
            injected = -self._damping() * device.v
        felt = self._share * self._filtered
        felt[:3] += injected
        before = device.p
        work = device.step(felt, self._now_s)
        kept = -float(injected @ (device.p - before))
        port = self.port.passed(work - kept)
        self.port = port._replace(damped=port.damped + max(0.0, kept))

    def _damping(self) -> float:
        """Return the damping that the passivity of the handle's port needs now [N·s/m]."""
        speed2 = float(self.device.v @ self.device.v)
        reserve = HANDLE_RESERVE * self._config.energy_bound
        most = MOST_DAMPING * self._config.handle.mass / STEP_S
        return min(most, damping(self.port, self._far, reserve, speed2, STEP_S))

    # --- what goes out ------------------------------------------------------------------------

    def stick(self, _now_s: float) -> Mapping[str, Any] | None:
        """Return what a `JoystickTwist` says now, None in silence."""
        if self.silent:
            return None
        handle = self._config.handle
        u = np.clip(self.device.p / handle.travel, -1.0, 1.0) * handle.speed
        return {"twist": (*u.tolist(), 0.0, 0.0, 0.0), "expressed_in": self.axes} | self._energy()

    def pose(self, _now_s: float) -> Mapping[str, Any] | None:
        """Return what a `MasterPose` says now, None in silence."""
        if self.silent:
            return None
        xyz = tuple(self.device.p.tolist())
        return {"xyz": xyz, "rpy": (0.0,) * 3, "expressed_in": self.axes} | self._energy()

    def _energy(self) -> dict[str, Any]:
        return {"handle": (self.port.entered, self.port.left, self.port.damped)}
