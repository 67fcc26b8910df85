"""Keep away from singularities: uphill in manipulability (Scott & Carignan 2008, eqs. 20–21)."""

from ....joints import Joints
from ....spatial import Array
from ...kinematics import Mechanism
from ..manipulability import slope
from ..objective import Objective, View


class Manipulability(Objective):
    """Climbs manipulability."""

    def __init__(self, joints: Joints, mechanism: Mechanism) -> None:
        self._rank = mechanism.rank

    def rate(self, view: View) -> Array:
        """Return the slope (n,) of manipulability as joint rates, for a gain of 1 /s."""
        return slope(view.J, self._rank)[1]
