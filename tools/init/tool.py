"""Place of the tool: from which face of the arm's last link it looks outward."""

from typing import Final

import numpy as np

from .draft import Draft
from .shape.shapes import Array
from .study import Study

BALL: Final = 0.012
"""Radius of the tool's ball [m]."""
STANDS_OUT: Final = 0.02
"""The ball stands out from the arm by so much [m]."""
AT_THE_JOINT: Final = 0.02
"""A tip link that is nearer to the last joint has its frame in it [m]."""
_TURNS: Final = 8
"""Angles of the last joint that the arm before it is looked at from [1]."""


class ToolSide:
    """The last body of an arm, as seen from its tip link."""

    def __init__(self, draft: Draft, study: Study) -> None:
        """Look at the capsules of the tip's body, and at those of the body before it."""
        forest = study.capsules.forest
        self._draft = draft
        body, T_body_tip = forest.body_of(draft.arm.tip)
        self._joint = -T_body_tip.R.T @ T_body_tip.p
        self._axis = T_body_tip.R.T @ forest.tree.axis[body - 1]
        middle = np.array(draft.postures["ready"])
        own: list[Array] = []
        before: list[Array] = []
        for k in range(_TURNS):
            q = middle.copy()
            q[-1] = middle[-1] + 2.0 * np.pi * k / _TURNS * (not draft.drives[-1].prismatic)
            placed = study.capsules.place(q[None])
            frame = placed.frames[0, body - 1]
            ends = (placed.ends[0] - frame[:, 3]) @ frame[:, :3]
            ends = (ends - T_body_tip.p) @ T_body_tip.R  # (c, 2, 3) in the tip link
            own = [ends[study.capsules.body == body].reshape(-1, 3)]
            before += [ends[study.capsules.body == body - 1].reshape(-1, 3)]
        self._own, self._before = own[0], np.concatenate(before)
        self._radii = np.repeat(study.capsules.radius[study.capsules.body == body], 2)

    def directions(self) -> list[Array]:
        """Return the axes of the tip link (3,), those that look outward first."""
        way = self._outward()
        axes = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
        return sorted(axes, key=lambda axis: -float(axis @ way))

    def put(self, outward: Array) -> None:
        """Put the MRF in front of all that is fixed to the last joint, and a stalk to it."""
        most = float((self._own @ outward + self._radii).max(initial=0.0))
        self._draft.mrf = outward * round(max(most, 0.0) + STANDS_OUT + BALL, 4)
        inside = max(most - 0.02, 0.0)
        self._draft.tool = (outward * round(inside, 4), BALL)

    def _outward(self) -> Array:
        """Return a direction away from the arm.

        From the last joint to the tip; where they are one, along the joint's axis, away from the
        body that carries it; and where that lies beside the axis, to the last body's middle.
        """
        way = -self._joint
        if float(np.linalg.norm(way)) >= AT_THE_JOINT:
            return way
        if len(self._before):
            carrier = float((self._before.mean(axis=0) - self._joint) @ self._axis)
        else:
            carrier = 0.0
        aside = np.zeros(3)
        if len(self._own):
            middle = self._own.mean(axis=0) - self._joint
            aside = middle - (middle @ self._axis) * self._axis
        if float(np.linalg.norm(aside)) > max(AT_THE_JOINT, abs(carrier)):
            return aside
        return np.asarray(self._axis if carrier <= 0.0 else -self._axis)
