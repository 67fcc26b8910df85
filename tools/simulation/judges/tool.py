"""Judge of the tool: its true distance from the target at the end of a run."""

from collections import deque

import numpy as np

from ....config.load import Cell
from ....protocols.messages.rig import RigTruth
from ....server.control.spatial import Pose, rotation_log

JUDGED_S = 0.5
"""The tool's error is the largest over this long before the end [s]."""


class ToolJudge:
    """Compares the physics' pose of one arm's MRF with its target, tick by tick."""

    def __init__(self, cell: Cell) -> None:
        """Judge the arm of one part of a cell."""
        self._mechanism = cell.config.mechanism.name
        mrf = cell.config.mechanism.T_wrist_mrf
        self._T_mrf_wrist = Pose.from_xyz_rpy(mrf.xyz, mrf.rpy).inverse()
        self._errors: deque[tuple[float, float] | None] = deque(
            maxlen=round(JUDGED_S / cell.config.timing.period_s)
        )

    def judge(self, truth: RigTruth, placed: tuple[str, Pose] | None, T_wrist_mrf: Pose) -> None:
        """Take in a tick: the truth, the target (its ground, its pose there), the MRF in force."""
        if placed is None:
            self._errors.append(None)
            return
        ground, target = placed
        if ground in truth.frames:  # judged by the ground's true pose
            target = _pose(truth.frames[ground]) @ target
        arm = truth.arms.get(self._mechanism)
        pose = truth.pose_mrf if arm is None else arm.pose_mrf
        true = _pose(pose) @ self._T_mrf_wrist @ T_wrist_mrf
        turn = rotation_log(target.R.T @ true.R)
        self._errors.append((float(np.linalg.norm(true.p - target.p)), float(np.linalg.norm(turn))))

    @property
    def error(self) -> tuple[float, float] | None:
        """Largest distance [m] and angle [rad] of late; None without a target all along."""
        judged = [error for error in self._errors if error is not None]
        if len(judged) != self._errors.maxlen:
            return None
        return max(e[0] for e in judged), max(e[1] for e in judged)


def _pose(six: tuple[float, float, float, float, float, float]) -> Pose:
    return Pose.from_xyz_rpy(six[:3], six[3:])
