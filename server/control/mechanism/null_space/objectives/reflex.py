"""Folding to pass below what is ahead (Zhang et al. 2013, section 4): what no tool shows of it."""

from typing import ClassVar

import numpy as np

from ....spatial import Array
from ..objective import Objective, View


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
