"""Judge of the tool: its true distance from the target at the end of a run."""

from collections import deque
from typing import NamedTuple

import numpy as np

from ....config.load import Cell
from ....protocols.messages.rig import RigTruth
from ....server.control.spatial import Pose, rotation_log

JUDGED_S = 0.5
"""The tool's error is the largest over this long before the end [s]."""


class _Seen(NamedTuple):
    """The truth of a tick, the target on its ground, and the MRF in force."""

    truth: RigTruth
    ground: str
    target: Pose
    T_wrist_mrf: Pose


class ToolJudge:
    """Compares the physics' pose of one arm's MRF with its target, tick by tick."""

    def __init__(self, cell: Cell) -> None:
        """Judge the arm of one part of a cell."""
        self._mechanism = cell.config.mechanism.name
        mrf = cell.config.mechanism.T_wrist_mrf
        self._T_mrf_wrist = Pose.from_xyz_rpy(mrf.xyz, mrf.rpy).inverse()
        self._seen: deque[_Seen | None] = deque(
            maxlen=round(JUDGED_S / cell.config.timing.period_s)
        )

    def judge(self, truth: RigTruth, placed: tuple[str, Pose] | None, T_wrist_mrf: Pose) -> None:
        """Take in a tick: the truth, the target (its ground, its pose there), the MRF in force."""
        self._seen.append(None if placed is None else _Seen(truth, *placed, T_wrist_mrf))

    @property
    def error(self) -> tuple[float, float] | None:
        """Largest distance [m] and angle [rad] of late; None without a target all along."""
        judged = [self._error(seen) for seen in self._seen if seen is not None]
        if len(judged) != self._seen.maxlen:
            return None
        return max(e[0] for e in judged), max(e[1] for e in judged)

    def _error(self, seen: _Seen) -> tuple[float, float]:
        """Return distance [m] and angle [rad] of the tool from its target in one tick."""
        truth, target = seen.truth, seen.target
        if seen.ground in truth.frames:  # judged by the ground's true pose
            target = _pose(truth.frames[seen.ground]) @ target
        arm = truth.arms.get(self._mechanism)
        pose = truth.pose_mrf if arm is None else arm.pose_mrf
        true = _pose(pose) @ self._T_mrf_wrist @ seen.T_wrist_mrf
        turn = rotation_log(target.R.T @ true.R)
        return float(np.linalg.norm(true.p - target.p)), float(np.linalg.norm(turn))


def _pose(six: tuple[float, float, float, float, float, float]) -> Pose:
    return Pose.from_xyz_rpy(six[:3], six[3:])
