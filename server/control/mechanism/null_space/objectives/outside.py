"""Objectives that look at obstacles: the potential field and the virtual spheres.

What they ask for is found before the task is resolved, because it also lets the tool leave its
path, and takes precedence over following.
"""

from typing import ClassVar

import numpy as np

from ....spatial import Array
from ..objective import Objective, View


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
