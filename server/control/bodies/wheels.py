"""An arm on a base that is driven: one redundant mechanism of base and arm; and a base on wheels.

Zhang et al. 2013, eqs. 7 and 8, weighted: η = J_W⁺ ẋ + P z with ẋ = ẋ_d + K (x_d − x), in which the
error is added (in print its sign is wrong). The base's share D of the work goes from 0, where the
arm works alone, to the cell's `weight`.

Relative to Base the arm works alone, and the base goes as it is driven. Relative to World an
operator's drive is z, which the arm answers, so that the tool stands or goes on as asked while the
base drives past below. Without a drive the base follows a tool that is asked to go. For the
objectives that the cell names, η_s is of the whole robot (eq. 7): the base takes its part in what
they ask of the arm. They depend on the arm's posture alone, so they ask nothing of the base itself,
and its own columns count in the manipulability whose slope they climb.
"""

from functools import partial

import numpy as np

from ....config.load import Cell
from ....config.schema.mechanism import DifferentialBaseSection, DrivenSection
from ..compiled import evolve
from ..inputs import DriveRequest, Inputs
from ..mechanism.model import Mechanism
from ..mechanism.redundancy import Field, Redundancy, shifted
from ..parameters import Parameters
from ..spatial import Array, Kinematics, sizes, twist_at
from ..wheels import DifferentialDrive
from .body import Builder, Resolver, SerialArm, Shares, judged_at
from .rates import ArmTick, JointRates

CREEPS, GOES = 0.005, 0.02
"""A tool that is asked for less than the first is the arm's alone; from the second on the base
follows in full, and in between in part [m/s]."""
STANDING = 1e-6
"""Share of the work of wheels that stand [1]: no division by zero."""
RESIDUE = 1e-9
"""A remainder of a twist below this is rounding [m/s, rad/s]."""
WHEELS = slice(0, 2)
"""Where the wheels are among the joints."""


class DrivenArm(SerialArm):
    """An arm on a base whose joints, the first ones, are driven by themselves, too."""

    def __init__(
        self,
        joints: slice,
        section: DrivenSection,
        p: Parameters,
        mechanism: Mechanism,
        redundancy: Redundancy,
        field: Field,
    ) -> None:
        """Build it; `joints` are the base's."""
        super().__init__(p, mechanism, redundancy, field)
        n, self._base = p.joints.n, joints
        self._alone, self._with = np.ones(n), np.ones(n)
        self._alone[joints], self._with[joints] = STANDING, section.weight
        self._shared = section.objectives
        self._arm_only = np.ones(n)
        self._arm_only[joints] = 0.0
        self._resolver = Resolver(p, redundancy, field, mechanism, self._arm_only)
        self._ranks = mechanism.arm_rank or mechanism.rank, mechanism.rank
        self._most, self._length = p.joints.velocity[joints], p.resolve.characteristic_length

    def asked(self, drive: DriveRequest) -> Array:
        """Return the base's rates of a drive, whatever its joints' bounds are."""
        raise NotImplementedError

    def driven(self, drive: DriveRequest, factor: float) -> Array:
        """Return the base's rates of a drive, in proportion inside their speed bounds.

        `factor` is the reduced-speed setting.
        """
        rates = factor * self.asked(drive)
        return np.asarray(rates / max(1.0, float((np.abs(rates) / (factor * self._most)).max())))

    def follows(self, twist: Array, request: ArmTick) -> float:  # noqa: ARG002  others look
        """Return how far the base follows the tool's twist (6,), 0 to 1."""
        return 1.0

    def holding_back(self, base: Array) -> Array:  # noqa: ARG002  others look
        """Return the shares (n,) of joints in what an arm cannot answer of a base's rates."""
        return self._with

    def with_drive(self, rates: Array, drive: DriveRequest, factor: float) -> Array:
        """Return joint rates (n,) with those of a driven base."""
        rates = rates.copy()
        rates[self._base] = self.driven(drive, factor)
        return rates

    def works_alone(self, inputs: Inputs) -> bool:
        """Return whether the tool is led relative to Base, so that the arm alone leads it."""
        return inputs.ground == "base"

    def rates(self, request: ArmTick) -> JointRates:
        """Return rates of base and arm at the commanded posture."""
        k, inputs, moving = request.kinematics, request.inputs, request.moving
        base, on_base = np.zeros(len(self._most)), self.works_alone(inputs) or not moving
        if moving:
            base = self.driven(inputs.drive, inputs.settings.speed_factor)
        driven = bool(np.count_nonzero(base))
        twist, part, whole = request.asked, 0.0, False
        if not (on_base or driven) and request.spare:
            gains = request.objectives.gains
            whole = any(gains[name] > 0.0 for name in self._shared)
            part = 1.0 if whole else self.follows(twist, request)
        if driven and not on_base:
            twist = twist - k.J[:, self._base] @ base
            request = evolve(request, asked=twist)
        D = self._alone.copy()
        D[self._base] = max(STANDING, part * self._with[0])
        alone, held = bool(D[0] == STANDING), request.held
        ranks = self._ranks if held is None else held.ranks
        shares = Shares(ranks[1] if part > 0.0 else ranks[0], D)
        found = self._resolver.rates(request, shares, whole)
        if not alone:
            return found
        dq = found.dq
        dq[self._base] = 0.0
        left = shifted(twist, found.give_way) - k.J @ dq
        if held is not None:
            left = held.part(left)
        dq[self._base] = base
        if not driven or on_base or float(np.abs(left).max()) <= RESIDUE:
            return found._replace(wheels_commanded=bool(self.synchronized))
        # The arm cannot answer the drive: the base goes no further than the tool allows.
        J, q = judged_at(k, request.lever).J, request.commanded.motion.q
        shares = Shares(ranks[1], self.holding_back(base))
        rest = self._resolver.resolve(q, J, left, request.lever, shares, held)
        return found._replace(dq=dq + rest.dq, limits=("singularity",))


class WheeledArm(DrivenArm):
    """An arm on two driven wheels, which turn together along an arc."""

    synchronized = (WHEELS,)

    def __init__(
        self,
        section: DifferentialBaseSection,
        p: Parameters,
        mechanism: Mechanism,
        redundancy: Redundancy,
        field: Field,
    ) -> None:
        """Build it."""
        super().__init__(WHEELS, section, p, mechanism, redundancy, field)
        self._rolling = DifferentialDrive.of(section.wheels)
        self.relief[WHEELS] = 0.0

    @classmethod
    def builder(cls, cell: Cell) -> Builder | None:
        """Return what builds it for a cell with a base on wheels."""
        base = cell.config.mechanism.base
        return None if base is None else partial(cls, base)

    def asked(self, drive: DriveRequest) -> Array:
        """Return the wheels' rates (2,) [rad/s] of a drive, on its arc."""
        return self._rolling.wheels(drive.speed, drive.turn)

    def follows(self, twist: Array, request: ArmTick) -> float:
        """Return how far wheels follow a tool: not where it creeps, they would grind to and fro."""
        v, w = sizes(twist_at(twist, request.lever))
        return min(1.0, max(0.0, (max(v, w * self._length) - CREEPS) / (GOES - CREEPS)))

    def posture(self, posture: Array, q: Array) -> Array:
        """Return a posture (n,) of the arm with the wheels as they are."""
        return np.concatenate((q[WHEELS], posture[2:]))

    def ahead(self, q: Array) -> float:
        """Return how far wheels have rolled ahead [m]; of rates, how fast they roll [m/s]."""
        return self._rolling.driven(q[WHEELS])[0]

    def path(self, k: Kinematics, relative_to_base: bool) -> Array:
        """Return the Jacobian (6, n) of what the tool does relative to Base, or to World."""
        return self._arm_only * k.J if relative_to_base else k.J
