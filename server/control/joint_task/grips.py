"""Where the arms of a joint task have its payload, in one tick."""

import math
from collections.abc import Sequence

from ..arm.arm import Arm
from ..evolve import evolve
from ..grasps.held import Held
from ..grasps.views import FOLLOW_TIME_S, TOLD, apart, follow, mean_of
from ..spatial import Array, Pose
from ..state import Memory


class Grips:
    """The grasps of some arms on one payload."""

    def __init__(
        self, name: str, arms: Sequence[Arm], nominal: Sequence[Pose], period_s: float
    ) -> None:
        """Build them for a task's name; `nominal` are T_wrist_mrf at start."""
        self._name, self._arms, self._nominal = name, tuple(arms), tuple(nominal)
        self._part = 1.0 - math.exp(-period_s / FOLLOW_TIME_S)

    def misfit(self, q: Sequence[Array]) -> float:
        """Return how far the arms' views are from the mean of all [m], each at its q (n,)."""
        views = [
            arm.mechanism.pose_wrist(own) @ T
            for arm, own, T in zip(self._arms, q, self._nominal, strict=True)
        ]
        return max(apart(mean_of(views), view)[0] for view in views)

    def taken(self, measured: Sequence[Pose], before: Sequence[Memory]) -> tuple[list[Held], Pose]:
        """Return the grasps of arms whose Wrists were measured at poses in World, and the payload.

        Its pose is the mean of the nominal views; what an event told of goes on being counted.
        """
        mean = mean_of([T @ nominal for T, nominal in zip(measured, self._nominal, strict=True)])
        found = []
        for memory, T in zip(before, measured, strict=True):
            view = T.inverse() @ mean
            told = 0 if memory.held is None else memory.held.redefined
            found.append(Held(self._name, view, view, redefined=told))
        return found, mean

    def followed(self, wrists: Sequence[Pose], before: Sequence[Memory]) -> tuple[list[Held], Pose]:
        """Return the grasps one period later, and where the payload is in World.

        That is the mean of the views of arms whose Wrists are at poses in World; they follow it.
        """
        held = [_held(memory) for memory in before]
        mean = mean_of([T @ h.T_wrist_payload for T, h in zip(wrists, held, strict=True)])
        found = []
        for T, h in zip(wrists, held, strict=True):
            view = follow(h.T_wrist_payload, T, mean, self._part)
            moved, turned = apart(h.told, view)
            told = moved > TOLD[0] or turned > TOLD[1]
            found.append(
                evolve(
                    h,
                    T_wrist_payload=view,
                    told=view if told else h.told,
                    redefined=h.redefined + told,
                )
            )
        return found, mean


def _held(memory: Memory) -> Held:
    if memory.held is None:
        raise ValueError("the arm holds nothing with others")
    return memory.held
