"""Joint rates beside a singularity: held off its boundary, led home from it.

With u the tool direction that fades, v the joint motion that fades with it, σ the singular value
and κ = uᵀ (∂J/∂q · v) v the curvature of the boundary: a command along u against κ leads out of the
workspace, and the motion v that answers it is braked so as to end above σ = 0; one along κ leads
home, and is answered with the full damped gain however small σ is.

At σ = 0 there is more than one motion that the tool hardly feels, and v is any of them. The one
that counts bends most along the command: the greatest eigenvalue of uᵀ (∂J/∂q · a) b over that
whole space. The way home along it can be gone in two senses, elbow up and elbow down: that which is
uphill in σ is chosen; joint limits decide where they leave only one open. Nothing else jumps:

- directions whose singular values are nearly the same are looked at together, as the command
  divides between them: where two cross, u and v are any of their sums;
- from v to the motion that bends most the answer goes over between floor and half of it, and
  motions count as unfelt the more the smaller their singular values are;
- where σ is zero, u may be any sum with directions that the arm never reaches: close to there,
  these count as well, as directions without a motion.
"""

import math
from typing import NamedTuple

import numpy as np

from ....config.schema.cell import ResolveSection
from ..spatial import Array
from .boundary import (
    CURVED,
    NO_COMMAND,
    bending_share,
    bounded,
    damped_rates,
    full_gain,
    unfelt_motions,
)

_TRAVEL = 0.4
"""A way home with less joint travel than this is not taken if the other has more [rad]."""

_SHARED = 0.2
"""Motions whose curvatures differ by less than this part of the greatest share the way home [1]."""


class Travel(NamedTuple):
    """How far each joint may still go (n,) [rad]."""

    below: Array
    above: Array

    def along(self, direction: Array) -> float:
        """Return how far all joints can go along a unit direction (n,) before one is stopped."""
        room = np.where(direction > 0.0, self.above, self.below)
        return float((room / np.maximum(np.abs(direction), 1e-9)).min())


class Directions(NamedTuple):
    """The weighted Jacobian taken apart, and a command."""

    J: Array
    """The Jacobian (6, n), not weighted."""
    length: float
    """Rotations weigh so much [m/rad]."""
    U: Array
    """Tool directions (6, 6)."""
    sigma: Array
    """Singular values (6,); zero for directions that the arm never reaches."""
    V: Array
    """Joint motions (r, n) of the directions that it reaches, the first ones."""
    null: Array
    """Spare motions (n − r, n)."""
    along: Array
    """Parts of the weighted command along U (6,)."""


class _WayHome(NamedTuple):
    """The motion that bends most along a command."""

    way: Array
    """Rates (n,) per gain, in the sense to be gone [m/s]."""
    share: float
    """Part of the command that is answered so, 0 to 1."""
    turned: bool
    """True where joint limits bar the way that is uphill."""


class Answer(NamedTuple):
    """Joint rates for a command, and how they came about."""

    dq: Array
    """(n,) [rad/s]."""
    way_home: Array | None
    """The part (n,) of them along motions that bend most [rad/s]; None: none."""
    singular: bool
    """True where damping acts on what was asked."""


def answer(at: Directions, p: ResolveSection, travel: Travel | None) -> Answer:
    """Return the rates (n,) [rad/s] that answer a command beside a singularity."""
    region, damping = p.singular_region, p.damping
    least = float(at.sigma[len(at.V) - 1])
    way = _way_home(at, p, travel) if least < p.floor else None
    share, turned = (0.0, False) if way is None else (way.share, way.turned)
    damped, singular = damped_rates(at[:], share, turned, region, damping, p.floor)
    home = np.zeros(len(damped)) if way is None else full_gain(least, region, damping) * way.way
    dq, part = bounded(damped, home, at.along, region, damping)
    return Answer(dq, None if way is None else part * home, singular)


def _way_home(at: Directions, p: ResolveSection, travel: Travel | None) -> _WayHome | None:
    """Return the motion that the tool hardly feels and that bends most along a command."""
    parts, size, basis, rows, bend = unfelt_motions(at[:], p.singular_region, p.floor)
    if size <= NO_COMMAND:
        return None
    values, vectors = np.linalg.eigh(bend)
    # Where motions bend both ways, those that bend more decide which way leads home.
    most, lead = float(values[-1]), float(values[-1] + min(values[0], 0.0))
    if lead <= 0.0:
        return None
    alike = np.maximum(0.0, 1.0 - (most - values) / (_SHARED * most))
    uphill = (at.sigma * parts)[: len(at.V)] @ at.V
    direction = ((vectors * alike) @ (vectors.T @ (rows @ uphill))) @ basis
    size_uphill = math.sqrt(float(direction @ direction))
    if size_uphill <= 1e-3 * NO_COMMAND * size:
        direction = vectors[:, -1] @ basis
        size_uphill = math.sqrt(float(direction @ direction))
    direction = direction / size_uphill
    per_bend = lead / most / CURVED
    share = bending_share(at[:], parts, direction, p.floor, per_bend)
    if share <= 0.0:
        return None
    turned = travel is not None and (
        travel.along(direction) < min(_TRAVEL, travel.along(-direction))
    )
    return _WayHome((-1.0 if turned else 1.0) * share * size * direction, share, turned)
