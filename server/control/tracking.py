"""Where a frame that moves is, from news that comes late, seldom and noisy. Pure.

A fading-memory filter of the second order (Zarchan, Musoff, "Fundamentals of Kalman Filtering",
section on fading-memory filters) over pose, twist and acceleration: a frame that moves at a
constant twist or acceleration is followed without steady error. Attitudes by the rotation
logarithm. Each estimate belongs to the tick that its news names, and is carried on to any other by
its own twist and acceleration; so what is late is no error as long as the motion is smooth.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from .frames import Array, Pose, pose_error, rotation_exp
from .tree import Body

NO_ACCELERATION = 3.0
"""A frame that has been known for less than this tells no acceleration yet [smoothing times]."""


class Doubt(StrEnum):
    """Why news was not believed."""

    QUALITY = "quality"
    JUMP = "jump"
    SPEED = "speed"
    LATE = "late"
    OUT_OF_ORDER = "out_of_order"
    NO_NEWS = "no_news"


class Track(NamedTuple):
    """What is known of a frame, at the tick of its newest news; in World."""

    tick: int
    T: Pose
    twist: Array
    acceleration: Array
    since: int
    """Tick of the first news that this builds upon."""

    def at(self, seconds: float) -> Body:
        """Return where it will be `seconds` after its tick, to the second order."""
        step = seconds * (self.twist + 0.5 * seconds * self.acceleration)
        T = Pose(rotation_exp(step[3:]) @ self.T.R, self.T.p + step[:3])
        return Body(T, self.twist + seconds * self.acceleration)


@dataclass(frozen=True)
class Plausible:
    """What a frame may do, and how its news is smoothed."""

    period_s: float
    least_quality: float
    speed: float
    angular_speed: float
    slack: float
    angular_slack: float
    smoothing_s: float


def observed(
    track: Track | None,
    tick: int,
    T: Pose,
    twist: Array | None,
    quality: float,
    plausible: Plausible,
) -> Track | Doubt:
    """Return what is known after news of `tick`, or why it was not believed.

    `T` is the frame's pose in World, `twist` (6,) its own twist in World axes, if it was measured.
    """
    p = plausible
    if quality < p.least_quality:
        return Doubt.QUALITY
    if twist is not None and _beyond(twist, p.speed, p.angular_speed):
        return Doubt.SPEED
    if track is None:
        return Track(tick, T, np.zeros(6) if twist is None else twist, np.zeros(6), tick)
    if tick <= track.tick:
        return Doubt.OUT_OF_ORDER
    dt = (tick - track.tick) * p.period_s
    far, turned = p.slack + p.speed * dt, p.angular_slack + p.angular_speed * dt
    if _beyond(pose_error(T, track.T), far, turned):
        return Doubt.JUMP
    return _filtered(track, tick, T, twist, dt, plausible)


def _filtered(
    track: Track, tick: int, T: Pose, twist: Array | None, dt: float, plausible: Plausible
) -> Track:
    # A memory no longer than what there is to remember: at first, two poses are a velocity.
    known_s = (tick - track.since) * plausible.period_s
    keep = math.exp(-dt / max(1e-9, min(plausible.smoothing_s, known_s)))
    forget = 1.0 - keep
    expected = track.at(dt)
    error = pose_error(T, expected.T)
    step = (1.0 - keep**3) * error
    if twist is None:
        v = expected.twist + (1.5 * forget**2 * (1.0 + keep) / dt) * error
        a = track.acceleration + (forget**3 / dt**2) * error
        if known_s < NO_ACCELERATION * plausible.smoothing_s:
            a = np.zeros(6)
    else:
        miss = twist - expected.twist
        v = expected.twist + (1.0 - keep**2) * miss
        a = track.acceleration + (forget**2 / dt) * miss
    R = rotation_exp(step[3:]) @ expected.T.R
    v = _within(v, plausible.speed, plausible.angular_speed)
    return Track(tick, Pose(R, expected.T.p + step[:3]), v, a, track.since)


def _beyond(six: Array, linear: float, angular: float) -> bool:
    return math.sqrt(six[:3] @ six[:3]) > linear or math.sqrt(six[3:] @ six[3:]) > angular


def _within(twist: Array, speed: float, angular_speed: float) -> Array:
    v, w = math.sqrt(twist[:3] @ twist[:3]), math.sqrt(twist[3:] @ twist[3:])
    if v <= speed and w <= angular_speed:
        return twist
    shares = (min(1.0, speed / max(v, 1e-12)), min(1.0, angular_speed / max(w, 1e-12)))
    return np.asarray(twist * np.repeat(shares, 3))
