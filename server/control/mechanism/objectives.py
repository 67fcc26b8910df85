"""Redundancy objectives: joint rates at a gain of 1, one row each by the name of its gain."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar, Final, NamedTuple

import numpy as np

from ....config.schema.null_space import RedundancySection
from ..axes import HeldAxes
from ..compiled import MATRIX, ROW, VECTOR, compiled
from ..inputs import Payload
from ..joints import Joints
from ..linalg import svd
from ..spatial import Array
from .model import Dynamics
from .potentials import manipulability_slope, slope_of

NOTHING: Final[Mapping[str, Array]] = MappingProxyType({})
"""Rates of the objectives that look at obstacles, where none does."""

# --- Protocol of redundancy objectives: joint rates at a gain of 1, for what one tick shows them
#
# An objective is one class here, one row in `KINDS` and one field of the cell file's
# `[redundancy]`. It knows the joints, the mechanism with its dynamics and its own section, and
# neither sources nor barriers nor other objectives.


class View(NamedTuple):
    """Inputs of the objectives in one tick."""

    q: Array
    """Commanded posture (n,) [rad]."""
    J: Array
    """Jacobian (6, n) of the tool there."""
    dq_task: Array
    """Joint rates (n,) of the task [rad/s]."""
    null: Array
    """Orthonormal rows (n − rank, n) that span the spare motions."""
    posture: Array
    """Joint angles (n,) that the posture objective pulls to [rad]."""
    outside: Mapping[str, Array] = NOTHING
    """Joint rates (n,) that obstacles ask for at a gain of 1, by the objective's name."""
    payload: Payload | None = None
    """What hangs on the force/torque sensor; None: the URDF's tool."""
    length: float = 1.0
    """Weight of radians against metres [m]."""
    held: HeldAxes | None = None
    """Axes that the task holds, of the point that J is at; None: all."""


class Objective(ABC):
    """Asks for joint rates; their part in the null space is what spare joints do."""

    WHOLE: ClassVar[bool] = False
    """Its rates are taken as they are, and their twist off that of the source of its name."""

    def __init__(  # noqa: B027 (most need no more)
        self, joints: Joints, dynamics: Dynamics, section: RedundancySection
    ) -> None:
        """Build it for one mechanism; it may tell its `dynamics` what they carry."""

    @abstractmethod
    def rate(self, view: View) -> Array:
        """Return joint rates (n,) [rad/s] at a gain of 1."""


# --- Rest: towards postures in which the joints carry least of the arm's weight -------------------
#
# Downhill in ½ |g(q)|² / G², where g are the joints' gravity torques and G the greatest that
# random postures need: static torque heats motors, and is missing where a task needs it
# (Hollerbach and Suh 1987, with gravity alone). The weight is that of the URDF, with Base as
# the cell has it.

_POSTURES: Final = 200
"""So many are tried to find the greatest torque [1]."""


class GravityTorque(Objective):
    """Relieves the joints of weight."""

    def __init__(self, joints: Joints, dynamics: Dynamics, section: RedundancySection) -> None:
        self._mechanism = mechanism = dynamics.mechanism
        draw = np.random.default_rng(0)
        postures = draw.uniform(joints.lower, joints.upper, (_POSTURES, joints.n))
        most2 = max(float(g @ g) for g, _ in map(mechanism.gravity, postures))
        self._weight = 1.0 / most2 if most2 > 0.0 else 0.0

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) downhill, for a gain of 1 /s [rad/s]."""
        g, slope = self._mechanism.gravity(view.q)
        return np.asarray(-self._weight * (g @ slope))


class HoldingTorque(Objective):
    """Relieves the drives of arm and payload: downhill in ½ Σ (gᵢ / ratedᵢ)².

    In parts of the greatest that random postures need with the URDF's tool.
    """

    def __init__(self, joints: Joints, dynamics: Dynamics, section: RedundancySection) -> None:
        self._dynamics, self._rated = dynamics, joints.rated_torque
        draw = np.random.default_rng(0)
        postures = draw.uniform(joints.lower, joints.upper, (_POSTURES, joints.n))
        each = (dynamics.gravity(q)[0] / self._rated for q in postures)
        most2 = max(float(load @ load) for load in each)
        self._weight = 1.0 / most2 if most2 > 0.0 else 0.0

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) downhill, for a gain of 1 /s [rad/s]."""
        if view.payload is not None:
            self._dynamics.carry(view.payload.mass, view.payload.com)
        g, slope = self._dynamics.gravity(view.q)
        return np.asarray(-self._weight * (g / self._rated**2) @ slope)


# --- Move with the least kinetic energy: spare joints move along where that saves some ------------
#
# Of all joint rates that do the task, dq = J⁺ẋ + N z, those of least ½ dqᵀ M dq are the ones of
# the inertia-weighted pseudo-inverse, M⁻¹Jᵀ(J M⁻¹ Jᵀ)⁻¹ ẋ. Setting the slope along the spare
# motions B to zero, B M (J⁺ẋ + Bᵀ y) = 0, gives the z = Bᵀ y that leads there from the task's
# rates, whatever resolved them. With spare motions E orthogonal in M, each takes its own: z =
# −Σ e (eᵀ M dq) / (eᵀ M e).

_MASSLESS: Final = 1e-9
"""Keeps a chain without inertia solvable [kg·m²]."""


class LeastEnergy(Objective):
    """Saves kinetic energy of the motion that the task asks for."""

    def __init__(self, joints: Joints, dynamics: Dynamics, section: RedundancySection) -> None:
        self._mechanism = dynamics.mechanism

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) that lead to the least energy at a gain of 1 [rad/s]."""
        return saving(view.dq_task, view.null, self._mechanism.mass_matrix(view.q))


def saving(dq_task: Array, null: Array, M: Array) -> Array:
    """Return z (n,) [rad/s] for the task's rates (n,) and the mass matrix M (n, n).

    `null` (n − rank, n) has orthonormal rows that span the spare motions.
    """
    z = np.zeros(len(dq_task))
    _save(dq_task, null, M, z)
    return z


@compiled(VECTOR, MATRIX, MATRIX, ROW)
def _save(dq_task: Array, null: Array, M: Array, z: Array) -> None:
    n = len(dq_task)
    momentum = np.zeros(n)
    for i in range(n):
        for j in range(n):
            momentum[i] += M[i, j] * dq_task[j]
    E = null.copy()
    ME = np.empty(E.shape)
    for r in range(len(E)):
        for before in range(r):
            common = 0.0
            for i in range(n):
                common += E[r, i] * ME[before, i]
            for i in range(n):
                E[r, i] -= common * E[before, i]
        size2 = saved = 0.0
        for i in range(n):
            ME[r, i] = _MASSLESS * E[r, i]
            for j in range(n):
                ME[r, i] += M[i, j] * E[r, j]
            size2 += E[r, i] * ME[r, i]
            saved += E[r, i] * momentum[i]
        for i in range(n):
            z[i] -= saved / size2 * E[r, i]
            ME[r, i] /= size2  # so that E need not be made of size one


# --- Keep away from singularities: uphill in manipulability (Scott & Carignan 2008, eqs. 20–21) ---


class Manipulability(Objective):
    """Climbs manipulability."""

    def __init__(self, joints: Joints, dynamics: Dynamics, section: RedundancySection) -> None:
        self._rank = dynamics.mechanism.rank

    def rate(self, view: View) -> Array:
        """Return the slope (n,) of manipulability as joint rates, for a gain of 1 /s."""
        return manipulability_slope(view.J, self._rank, view.held)[1]


# --- Dexterity by singular values: the least, the least by the greatest, along one direction ------
#
# With the singular value decomposition Σ uᵢ σᵢ vᵢᵀ of J, rotations weighed by a length, ∂σᵢ/∂J =
# uᵢ vᵢᵀ. Where two singular values cross, the least of them has no slope: a norm stands in for it,
# least = (Σ σᵢ^−p)^(−1/p), which is up to 6^(1/p) less and smooth in J; so for the greatest. Only
# axes that the mechanism reaches anywhere count (Klein and Blaho 1987), and that the task holds.
#
# Along a unit vector e the tool goes, its other axes held, at most w = (eᵀ(J Jᵀ)⁻¹e)^(−½) with
# joint rates of size 1 (Chiu 1988): with y = (J Jᵀ)⁻¹ e, ∂w/∂J = w³ y (Jᵀy)ᵀ. Beside a singularity
# that lies almost across e, that slope has no bound: J Jᵀ + ρ² 1 stands in for J Jᵀ.

_NORM: Final = 8
"""Power p of the norms that stand for least and greatest [1]."""
_NEAREST: Final = 1e-7
"""Singular values count no less: at a singularity slopes stay finite [m]."""
_DAMPING: Final = 0.1
"""ρ: singular values well below it count little along a direction [m]."""
_SIDEWAYS: Final = 1e-9
"""Part of a direction that an arm does not reach, squared, which is rounding [1]."""


class _Dexterity(Objective):
    """Climbs a function of the tool's Jacobian."""

    def __init__(self, joints: Joints, dynamics: Dynamics, section: RedundancySection) -> None:
        self._rank = dynamics.mechanism.rank

    def rate(self, view: View) -> Array:
        """Return the slope (n,) of the function as joint rates, for a gain of 1."""
        return slope_of(view.J, self._value_and_slope(view)[1], view.held)

    def value(self, view: View) -> float:
        """Return the function that it climbs."""
        return self._value_and_slope(view)[0]

    @abstractmethod
    def _value_and_slope(self, view: View) -> tuple[float, Array]:
        """Return the function f, and ∂f/∂J (6, n) of the task's rows."""

    def _rows(self, view: View) -> tuple[Array, int]:
        """Return the task's rows (6, n), with their slack beside, and how many are reached."""
        if view.held is None:
            return view.J, self._rank
        return view.held.rows(view.J), view.held.rank

    def _least(self, view: View, power: int) -> tuple[float, Array]:
        """Return the norm of the singular values that stands for the least, and its ∂/∂J (6, n).

        For the greatest with a `power` below zero [m].
        """
        J, rank = self._rows(view)
        U, s, Vt = svd(J, view.length)
        sigma = np.maximum(s[:rank], _NEAREST)
        end = sigma[-1] if power > 0 else sigma[0]
        value = end * float(((end / sigma) ** power).sum()) ** (-1.0 / power)
        F = (U[:, :rank] * (value / sigma) ** (power + 1)) @ Vt[:rank]
        F[3:] *= view.length
        return value, F


class LeastSingularValue(_Dexterity):
    """Climbs the least singular value."""

    def _value_and_slope(self, view: View) -> tuple[float, Array]:
        return self._least(view, _NORM)


class Condition(_Dexterity):
    """Climbs the least singular value by the greatest: 1 is as quick in every direction."""

    def _value_and_slope(self, view: View) -> tuple[float, Array]:
        (least, F), (most, G) = self._least(view, _NORM), self._least(view, -_NORM)
        return least / most, (F - least / most * G) / most


class AlongDirection(_Dexterity):
    """Climbs manipulability along a direction in World."""

    def __init__(self, joints: Joints, dynamics: Dynamics, section: RedundancySection) -> None:
        super().__init__(joints, dynamics, section)
        self._e = np.zeros(6)
        self._e[:3] = np.array(section.along_direction) / math.hypot(*section.along_direction)

    def _value_and_slope(self, view: View) -> tuple[float, Array]:
        J, rank = self._rows(view)
        U, s, _ = svd(J, view.length)
        reached = U[:, :rank]
        part = reached.T @ self._e
        if float(part @ part) < 1.0 - _SIDEWAYS:  # a planar arm, at an angle to its plane
            return 0.0, np.zeros(J.shape)
        y = reached @ (part / (s[:rank] ** 2 + _DAMPING**2))
        y[3:] *= view.length
        w = float(self._e @ y) ** -0.5
        return w, w**3 * np.outer(y, J.T @ y)


# --- Keep joints near the middle of their range (Scott & Carignan 2008, eqs. 17–19, as a rate) ----

WIDEST = np.pi
"""Ranges beyond ±π pull no harder than this one [rad]."""


class MidRange(Objective):
    """A spring to mid-range, weaker for joints with more room."""

    def __init__(self, joints: Joints, dynamics: Dynamics, section: RedundancySection) -> None:
        self._middle = 0.5 * (joints.lower + joints.upper)
        half = np.minimum(0.5 * (joints.upper - joints.lower), WIDEST)
        self._weight = half.min() / half

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) to mid-range, for a gain of 1 /s [rad/s]."""
        return np.asarray(self._weight * (self._middle - view.q))


# --- Objectives that look at obstacles: the potential field and the virtual spheres ---------------
#
# What they ask for is found before the task is resolved, because it also lets the tool leave
# its path, and takes precedence over following.


class _Outside(Objective):
    """Hands on what is found elsewhere."""

    NAME: ClassVar[str]

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) [rad/s] that obstacles ask for; zeros where none does."""
        return view.outside.get(self.NAME, np.zeros(len(view.q)))


class FieldDescent(_Outside):
    """Downhill in the potential field."""

    NAME = "field"


class Spheres(_Outside):
    """Away from what is inside the virtual spheres (Hamaguchi, Taniguchi, eq. 8)."""

    NAME = "spheres"


# --- Keep the joints near a posture: whatever freedom the task leaves takes them there ------------


class Posture(Objective):
    """A spring to the posture that the cell or an operator names."""

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) to the posture, for a gain of 1 /s [rad/s]."""
        return view.posture - view.q


# --- Folding to pass below what is ahead (Zhang et al. 2013, section 4): what no tool shows of it


class Folding(Objective):
    """The rates z of joints that fold to a posture.

    Williams 1997, eq. 7, has J⁺ẋ + (1 − J⁺J) z. The source of the same name asks for J z. So that
    the joints go straight to the posture through a stretched elbow or wrist, where J⁺J is not 1,
    the two are computed as z + J⁺(ẋ − J z): whole.
    """

    WHOLE: ClassVar[bool] = True

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) of folding [rad/s]; zeros where nothing folds."""
        return view.outside.get("reflex", np.zeros(len(view.q)))


# --- The redundancy objectives that there are: one row each, by the name of its gain in the cell

KINDS: Final = MappingProxyType[str, type[Objective]](
    {
        "mid_range": MidRange,
        "manipulability": Manipulability,
        "posture": Posture,
        "least_energy": LeastEnergy,
        "field": FieldDescent,
        "spheres": Spheres,
        "gravity_torque": GravityTorque,
        "holding_torque": HoldingTorque,
        "sigma_min": LeastSingularValue,
        "condition": Condition,
        "along": AlongDirection,
        "reflex": Folding,
    }
)
