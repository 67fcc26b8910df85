"""Plausibility of sightings: from a known target and a picture to the next known target. Pure.

A target is known in its anchor: the frame in which it stands still, World before a carried
camera, the Wrist before one that stands beside the arm. There the arm's own motion is no motion of
the target, and an implausible one shows whatever the arm does.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

from ...control.spatial import Array, Pose, rotation_exp, rotation_log

AMBIGUOUS_BELOW = 2.0
"""Two poses are told apart when one fits worse by this factor at least [1]."""

NOISE_PX = 0.15
"""Reprojection errors below this tell nothing [px]."""


class PictureRejection(StrEnum):
    """Reason to reject a picture."""

    NO_TAG = "no_tag"
    QUALITY = "quality"
    AMBIGUOUS = "ambiguous"
    JUMP = "jump"
    LATE = "late"
    OUT_OF_ORDER = "out_of_order"
    NO_PICTURE = "no_picture"


@dataclass(frozen=True)
class KnownTarget:
    """Pose of a target as last believed."""

    T_anchor_target: Pose
    """Filtered over the pictures that were believed."""
    tick: int
    """To which the newest of them belongs."""


@dataclass(frozen=True)
class SightingBounds:
    """Bounds of the difference between two pictures: speeds, and slack for noise."""

    period_s: float
    least_quality: float
    speed: float
    angular_speed: float
    slack: float
    angular_slack: float
    smoothing_s: float


def judge(
    known: KnownTarget | None,
    tick: int,
    poses: tuple[Pose, ...],
    errors_px: tuple[float, ...],
    quality: float,
    belief: SightingBounds,
) -> KnownTarget | PictureRejection:
    """Return what is known after a picture of `tick`, or why it was not believed.

    `poses` are the one or two poses of the target in its anchor that fit the picture, the better
    one first, `errors_px` how well each fits.
    """
    if not poses:
        return PictureRejection.NO_TAG
    if quality < belief.least_quality:
        return PictureRejection.QUALITY
    apart = len(poses) == 1 or errors_px[1] > AMBIGUOUS_BELOW * max(errors_px[0], NOISE_PX)
    if known is None:
        return KnownTarget(poses[0], tick) if apart else PictureRejection.AMBIGUOUS
    if tick <= known.tick:
        return PictureRejection.OUT_OF_ORDER
    elapsed = (tick - known.tick) * belief.period_s
    believable = [p for p in (poses[:1] if apart else poses) if _near(known, p, elapsed, belief)]
    if not believable:
        return PictureRejection.JUMP
    best = min(believable, key=lambda p: _angle(known.T_anchor_target, p))
    share = 1.0 if belief.smoothing_s == 0.0 else -math.expm1(-elapsed / belief.smoothing_s)
    return KnownTarget(_between(known.T_anchor_target, best, share), tick)


def _near(known: KnownTarget, T: Pose, elapsed_s: float, belief: SightingBounds) -> bool:
    way = _norm(T.p - known.T_anchor_target.p)
    return (
        way <= belief.slack + belief.speed * elapsed_s
        and _angle(known.T_anchor_target, T)
        <= belief.angular_slack + belief.angular_speed * elapsed_s
    )


def _between(a: Pose, b: Pose, share: float) -> Pose:
    turn = rotation_log(a.R.T @ b.R)
    return Pose(a.R @ rotation_exp(share * turn), a.p + share * (b.p - a.p))


def _angle(a: Pose, b: Pose) -> float:
    return _norm(rotation_log(a.R.T @ b.R))


def _norm(v: Array) -> float:
    return math.sqrt(float(v @ v))
