"""What gentle presses tell of what a tool touches, and gains for it, with their margins.

Stiffness is the change of the steady force for that of the measured depth. It holds all that gives
way outside of the drives' encoders: what is touched, the tool, the sensor, links, and gears where
the encoders sit on the motors. What joints sag by against their drives is measured with them, and
is not part of it.

The delay is what is seen at the pace of a press, in two parts: measured depth behind the commanded
one on the way through the air, and the force behind the measured depth. Drives are slower to turn
than to go on, so the cell's own model, which `check` judges by, may tell more; the greater one
counts.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...config.load import Cell, altered
from ..control.spatial import Array
from ..stability.judgement import LoopBounds
from ..stability.loops import ForceLoop, bound
from .payload import NotIdentified


class Along(NamedTuple):
    """An axis of the MRF, and which way along it."""

    axis: int
    sign: float

    @classmethod
    def of(cls, name: str) -> "Along":
        """Return it by its name, such as "z" or "-x"."""
        return cls("xyz".index(name[-1]), -1.0 if name.startswith("-") else 1.0)


class Sample(NamedTuple):
    """One state along the press."""

    time_s: float
    tick: int
    force: float  # less the offset in the air [N]
    commanded: float  # depth from where it set out [m]
    measured: float  # [m]


@dataclass(frozen=True)
class Steady:
    """Means over a steady press."""

    force: float  # [N]
    commanded: float  # depth [m]
    measured: float  # [m]


# --- What the presses tell ------------------------------------------------------------------------
LATEST = 8.0  # a force is looked for no further behind the depth [periods]
TELLING = 0.25  # stiffnesses that differ by more of their mean tell too little [1]


@dataclass(frozen=True)
class Environment:
    """What a tool touched."""

    stiffness: float  # by the measured depth [N/m]
    repeatability: float  # half the range over the presses [N/m]
    with_drives: float  # by the commanded depth: what drives sag by gives way as well [N/m]
    damping: float  # [N·s/m]
    delay_periods: float  # of the loop as seen, without the lag of the jerk limit [periods]
    model_periods: float  # the same by the cell's own model [periods]
    forces: tuple[float, float]  # of the lighter and the harder press [N]
    depth: float  # between them, measured [m]


def environment(
    cell: Cell, along: Along, steady: Sequence[Steady], way: list[Sample], samples: list[Sample]
) -> Environment:
    """Return what presses along an axis tell of what was touched.

    Steady ones, lighter and harder in turns, and states on the way through the air and of the
    presses. Raises `NotIdentified`.
    """
    rows = np.array([(s.force, s.measured, s.commanded) for s in steady])
    # Each press against the one before: what drifts slowly falls out of it.
    steps = np.diff(rows, axis=0)
    depth = float(np.abs(steps[:, 1]).mean())
    if (steps[:, 0] * steps[:, 1] <= 0.0).any():
        raise NotIdentified(
            f"pressed harder, the tool goes back by {1e6 * depth:.3g} µm: the direction of a joint "
            "or of an axis of the sensor, or what is touched is stiffer than encoders tell"
        )
    each = steps[:, 0] / steps[:, 1]
    stiffness, apart = float(each.mean()), float(np.ptp(each)) / 2.0
    if apart > TELLING * stiffness:
        raise NotIdentified(
            f"presses tell {each.min():.3g} to {each.max():.3g} N/m, over {1e6 * depth:.3g} µm: "
            "too far apart"
        )
    axis = ForceLoop(cell).axes(cell.config.sources.force.gain)[along.axis]
    if axis is None:
        raise NotIdentified("the arm cannot move along that axis")
    behind, damping = _force_delay(samples)
    return Environment(
        stiffness=stiffness,
        repeatability=apart,
        with_drives=float((steps[:, 0] / steps[:, 2]).mean()),
        damping=damping,
        # A state tells the command of the tick before, and what is decided now acts a period later.
        delay_periods=_drive_delay(way) + behind,
        model_periods=axis.delay_periods - axis.delays["jerk limit"],
        forces=(float(rows[0::2, 0].mean()), float(rows[1::2, 0].mean())),
        depth=depth,
    )


def _drive_delay(way: list[Sample]) -> float:
    """Return by how much the measured depth is behind the commanded one [periods]."""
    ticks, commanded, measured = np.array([(s.tick, s.commanded, s.measured) for s in way]).T
    speed = float(np.polyfit(ticks - ticks[0], commanded, 1)[0])
    return float((commanded - measured).mean()) / speed


def _force_delay(samples: list[Sample]) -> tuple[float, float]:
    """Return by how much the force is behind the measured depth [periods], and damping [N·s/m].

    Least squares of `F(t) = k x(t − d) + b ẋ(t − d) + c`.
    """
    ticks, times, force, depth = np.array(
        [(s.tick, s.time_s, s.force, s.measured) for s in samples]
    ).T
    inner = (ticks - ticks[0] > LATEST) & (ticks[-1] - ticks > LATEST)
    speed = np.gradient(depth, times)

    def fit(delay: float) -> tuple[float, float]:
        then = ticks[inner] - delay
        moved, moving = np.interp(then, ticks, depth), np.interp(then, ticks, speed)
        regressor = np.column_stack([moved - depth.mean(), moving, np.ones(len(moved))])
        found, rest, *_ = np.linalg.lstsq(regressor, force[inner], rcond=None)
        return float(rest[0]) if len(rest) else math.inf, float(found[1])

    candidates = np.arange(0.0, LATEST, 0.05)
    fits = [fit(float(d)) for d in candidates]
    best = int(np.argmin([rest for rest, _ in fits]))
    return float(candidates[best]), fits[best][1]


# --- Gains for what was touched -------------------------------------------------------------------
SHARE = 0.5
"""Proposed gains are that part of what is stable: a gain margin of two [1]."""
MOST_DAMPING = 1e4  # of following, that a cell may have [N·s/m]
_HALVINGS = 30


@dataclass(frozen=True)
class Proposal:
    """Gains for a stiffness, and how far from their bounds they are."""

    stiffness: float  # as the loop feels it, with what damps [N/m]
    gain: tuple[float, ...]  # K_F (6,) [m/s/N, rad/s/(N·m)]
    loop_gain: float  # K_F k T along the press, k as the loop feels it [1]
    bound: float  # greatest stable one, with the greater delay of both [1]
    share: float  # of the tool's worst contact: loop gain over bound, as `check` judges it [1]
    damping: float | None  # B [N·s/m]; None where none that a cell may have is enough
    hand_share: float  # stiffness over the stiffest that following bears with it [1]


def felt_stiffness(found: Environment, period_s: float) -> float:
    """Return the stiffness of a spring that the loop bears as well as what was found [N/m].

    What damps pushes back against a change as well, and is not counted where it helps. Of the loop
    `K (k T + b (1 − z⁻¹)) z⁻ᵈ / (z − 1)` with the greater delay d, the greatest stable K is found
    where its phase is −π; with b = 0 it is `2 sin(π/(2(2d + 1))) / (k T)`.
    """
    delay = max(found.delay_periods, found.model_periods)
    spring = max(found.stiffness, found.with_drives) * period_s
    w = np.linspace(1e-3, math.pi, 4000)
    felt = spring + max(found.damping, 0.0) * -np.expm1(-1j * w)
    phase = np.angle(felt) - (delay + 0.5) * w - 0.5 * math.pi
    at = int(np.argmax(phase <= -math.pi))
    most = 2.0 * math.sin(0.5 * w[at]) / abs(felt[at])
    return float(max(bound(delay) / most, spring) / period_s)


def propose(cell: Cell, found: Environment, along: Along) -> Proposal:
    """Return force control's K_F, and following's B, for what was touched.

    The cell's own K_F is scaled, so that no contact of the tool is nearer to its bound than
    `SHARE`. Only along the press is it raised: how stiff things are sideways, and about an axis,
    was not felt. Raises `ConfigError` where the cell may not have that stiffness.
    """
    stiffness = felt_stiffness(found, cell.config.timing.period_s)
    hard = altered(cell, {"mechanism.force_torque.stiffest_environment": stiffness})
    bounds, own = LoopBounds(hard), np.array(cell.config.sources.force.gain)
    late = max(0.0, found.delay_periods - found.model_periods)

    def scaled(factor: float, others: float = 1.0) -> Array:
        factors = np.full(6, min(factor, others))
        factors[along.axis] = factor
        return np.asarray(own * factors)

    scale = _greatest(lambda s: bounds.gain("force", scaled(s)).share <= SHARE, 1e-6, 1e3)
    axis = ForceLoop(hard).axes(scaled(scale))[along.axis]
    told = 0.0 if axis is None else axis.delay_periods
    later = bound(told) / bound(told + late)
    scale /= later
    # What is later than the model says is so for every axis, not for the one along the press alone.
    others = _greatest(
        lambda s: bounds.gain("force", scaled(scale, min(s, 1.0))).share * later <= SHARE, 1e-6, 2.0
    )
    gain = scaled(scale, min(others, 1.0))
    damping, hand_share = _damping(cell, stiffness)
    return Proposal(
        stiffness=stiffness,
        gain=tuple(float(f"{g:.3g}") for g in gain),
        loop_gain=float(gain[along.axis]) * stiffness * cell.config.timing.period_s,
        bound=bound(told + late),
        share=bounds.gain("force", gain).share * later,
        damping=damping,
        hand_share=hand_share,
    )


def _damping(cell: Cell, stiffness: float) -> tuple[float | None, float]:
    """Return the least B with which following bears a stiffness, and its share of the bound."""

    def share(damping: float) -> float:
        changes = {"damping": damping, "stiffest_hand": stiffness}
        following = altered(cell, changes, "sources.following")
        return LoopBounds(following).gain("following", cell.config.sources.following.gain).share

    at_most = share(MOST_DAMPING)
    if at_most > SHARE:
        return None, at_most
    less = _greatest(lambda s: share(MOST_DAMPING / s) <= SHARE, 1.0, 1e6)
    damping = float(f"{MOST_DAMPING / less:.3g}")
    return damping, share(damping)


def _greatest(holds: Callable[[float], bool], least: float, most: float) -> float:
    """Return the greatest factor for which something holds that holds at `least`."""
    low, high = math.log10(least), math.log10(most)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(10.0**middle) else (low, middle)
    return float(10.0**low)
