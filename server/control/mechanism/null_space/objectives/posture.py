"""Keep the joints near a posture: whatever freedom the task leaves takes them there."""

from ....spatial import Array
from ..objective import Objective, View


class Posture(Objective):
    """A spring to the posture that the cell or an operator names."""

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) to the posture, for a gain of 1 /s [rad/s]."""
        return view.posture - view.q
