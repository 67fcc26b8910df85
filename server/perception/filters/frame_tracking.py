"""Tracking filter of a moving frame, from news that is late, seldom and noisy. Pure.

A fading-memory filter of the second order (Zarchan, Musoff, "Fundamentals of Kalman Filtering",
section on fading-memory filters) over pose, twist and acceleration: a frame that moves at a
constant twist or acceleration is followed without steady error. Attitudes by the rotation
logarithm. Each estimate belongs to the tick that its news names, and is carried on to any other by
its own twist and acceleration; so what is late is no error as long as the motion is smooth.

Anybody may send news, so a frame is never believed to move faster, to accelerate more or to be
further away than its cell says: what would need that is not believed, and estimates are kept
inside.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ...control.frame_tree import Body
from ...control.spatial import Array, Pose, pose_error, rotation_exp

NO_ACCELERATION = 3.0
"""A frame that has been known for less than this tells no acceleration yet [smoothing times]."""


class NewsRejection(StrEnum):
    """Reason to reject news of a frame."""

    QUALITY = "quality"
    JUMP = "jump"
    SPEED = "speed"
    ACCELERATION = "acceleration"
    EXTENT = "extent"
    LATE = "late"
    OUT_OF_ORDER = "out_of_order"
    CONTRADICTION = "contradiction"
    NO_NEWS = "no_news"


class RejectedNews(NamedTuple):
    """Rejected news: the reason, the value that was too large, and its bound."""

    doubt: NewsRejection
    value: float
    bound: float
    unit: str = ""

    @property
    def words(self) -> str:
        """For people."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.doubt}: {self.value:.3g}{unit}, bound {self.bound:.3g}{unit}"

    @property
    def contradicts(self) -> bool:
        """True where what was believed before and this cannot both be true."""
        return self.doubt in _CONTRADICTING


_CONTRADICTING = frozenset(
    (
        NewsRejection.JUMP,
        NewsRejection.SPEED,
        NewsRejection.ACCELERATION,
        NewsRejection.EXTENT,
        NewsRejection.CONTRADICTION,
    )
)


class Track(NamedTuple):
    """Estimated motion of a frame at the tick of its newest news, in World."""

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
class PlausibleMotion:
    """Bounds of a frame's motion, and the smoothing of its news."""

    period_s: float
    least_quality: float
    speed: float
    angular_speed: float
    slack: float
    angular_slack: float
    smoothing_s: float
    acceleration: float
    angular_acceleration: float
    extent: tuple[float, float]
    """How far from `home` it may be [m], [rad]; infinite: anywhere."""
    home: Pose
    """Where it stands in World until there is news of it."""


def update_track(
    track: Track | None,
    tick: int,
    T: Pose,
    twist: Array | None,
    quality: float,
    plausible: PlausibleMotion,
) -> Track | RejectedNews:
    """Return what is known after news of `tick`, or why it was not believed.

    `T` is the frame's pose in World, `twist` (6,) its own twist in World axes, if it was measured.
    """
    p = plausible
    if quality < p.least_quality:
        return RejectedNews(NewsRejection.QUALITY, quality, p.least_quality)
    doubted = _beyond(NewsRejection.EXTENT, pose_error(T, p.home), p.extent, ("m", "rad"))
    if doubted is None and twist is not None:
        doubted = _beyond(NewsRejection.SPEED, twist, (p.speed, p.angular_speed), ("m/s", "rad/s"))
    if doubted is not None:
        return doubted
    if track is None:
        return Track(tick, T, np.zeros(6) if twist is None else twist, np.zeros(6), tick)
    dt = (tick - track.tick) * p.period_s
    late = tick <= track.tick
    way = p.speed * abs(dt), p.angular_speed * abs(dt)
    far = (p.slack + way[0], p.angular_slack + way[1])
    kind = NewsRejection.CONTRADICTION if late else NewsRejection.JUMP
    doubted = _beyond(kind, pose_error(T, track.T), far, ("m", "rad"))
    if doubted is None and _settled(track, p):
        # What is known and what is true may accelerate in opposite senses.
        far = (
            p.slack + p.acceleration * dt * dt,
            p.angular_slack + p.angular_acceleration * dt * dt,
        )
        off = pose_error(T, track.at(dt).T)
        kind = NewsRejection.CONTRADICTION if late else NewsRejection.ACCELERATION
        doubted = _beyond(kind, off, far, ("m", "rad"))
    if doubted is None and late:
        doubted = RejectedNews(NewsRejection.OUT_OF_ORDER, tick, track.tick + 1)
    return doubted or _filtered(track, tick, T, twist, dt, plausible)


def _settled(track: Track, p: PlausibleMotion) -> bool:
    """Return whether a frame has been known for long enough to tell how it moves."""
    return (track.tick - track.since) * p.period_s >= NO_ACCELERATION * p.smoothing_s


def _filtered(
    track: Track, tick: int, T: Pose, twist: Array | None, dt: float, plausible: PlausibleMotion
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
        if not _settled(track, plausible):
            a = np.zeros(6)
    else:
        miss = twist - expected.twist
        v = expected.twist + (1.0 - keep**2) * miss
        a = track.acceleration + (forget**2 / dt) * miss
    R = rotation_exp(step[3:]) @ expected.T.R
    p = plausible
    if _settled(track, p):  # at first, how fast it is has to be found out
        most = (p.acceleration * dt, p.angular_acceleration * dt)
        v = track.twist + within(v - track.twist, most)
    v = within(v, (p.speed, p.angular_speed))
    a = within(a, (p.acceleration, p.angular_acceleration))
    return Track(tick, Pose(R, expected.T.p + step[:3]), v, a, track.since)


def _beyond(
    doubt: NewsRejection, six: Array, most: tuple[float, float], units: tuple[str, str]
) -> RejectedNews | None:
    """Return the doubt about a (6,) whose linear or angular part is larger than `most`."""
    for part, bound, unit in zip((six[:3], six[3:]), most, units, strict=True):
        size = math.sqrt(part @ part)
        if size > bound:
            return RejectedNews(doubt, size, bound, unit)
    return None


def within(six: Array, most: tuple[float, float]) -> Array:
    """Return a (6,) whose linear and angular part are each shortened to at most `most`."""
    v, w = math.sqrt(six[:3] @ six[:3]), math.sqrt(six[3:] @ six[3:])
    if v <= most[0] and w <= most[1]:
        return six
    shares = (min(1.0, most[0] / max(v, 1e-12)), min(1.0, most[1] / max(w, 1e-12)))
    return np.asarray(six * np.repeat(shares, 3))
