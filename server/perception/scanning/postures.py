"""Critical points of an arm (shoulder, elbow, tool), and the postures among which a way is sought.

All in the plane's frame, at the arm's foot. Joints are the arm's alone, without wheels and tilt;
those beyond the elbow's keep their angles.
"""

from typing import Final, NamedTuple

import numpy as np

from ....config.load import Cell, ConfigError
from ....config.schema.section import Vector3
from ...control.proximity.forest import Forest
from ...control.spatial import Array, Pose

STEPS: Final = np.radians([20.0, 10.0, 20.0, 12.0])
"""The grid of postures: steps of the joints up to the elbow's [rad]."""
LOWEST: Final = 0.10
"""Elbow and tool stay so far above the arm's foot [m]: there the chassis is."""
FROM_COLUMN: Final = 0.15
"""The tool stays so far from the column between foot and shoulder [m]."""

DISTINCT: Final = 0.01
"""Critical points are farther apart [m]."""


class Candidates(NamedTuple):
    """The postures of the grid that do not meet foot or column."""

    q: Array
    """Joints up to the elbow's (s, lead) [rad]."""
    elbow: Array
    """(s, 3) [m]."""
    R: Array
    """Attitude of what follows the elbow's joint (s, 3, 3)."""


class CriticalPoints:
    """Shoulder, elbow, joints behind it, and tool of an arm."""

    def __init__(self, part: Cell, shoulder: str, elbow: str, foot: Vector3 = (0.0,) * 3) -> None:
        """Read them from the URDF: origins of two joints, seen from the `foot` in Base [m].

        Raises `ConfigError` for unknown ones.
        """
        self.arm = arm_joints(part)
        """Which of the mechanism's joints are the arm's."""
        joints = [part.robot.joints[i] for i in self.arm]
        drives = [part.config.mechanism.drives[i] for i in self.arm]
        names = [joint.name for joint in joints]
        for key, name in (("shoulder", shoulder), ("elbow", elbow)):
            if name not in names:
                raise ConfigError(
                    f"{part.path}: contour.{key}: value '{name}': the arm has no such joint: "
                    + ", ".join(names)
                )
        self._forest, self._n = Forest(part), len(part.robot.joints)
        self._foot = Pose(np.eye(3), -np.array(foot))
        mechanism = part.config.mechanism
        mrf = mechanism.T_wrist_mrf
        self._body, T_body_wrist = self._forest.body_of(part.prefix + mechanism.tip_link)
        self._T_tool = T_body_wrist @ Pose.from_xyz_rpy(mrf.xyz, mrf.rpy)
        self._shoulder, self._elbow = names.index(shoulder), names.index(elbow)
        self.lower = np.array([joint.lower for joint in joints])
        self.upper = np.array([joint.upper for joint in joints])
        margin = np.array([drive.position_margin for drive in drives])
        self.lower, self.upper = self.lower + margin, self.upper - margin
        self.lead = self._elbow + 1
        """Joints up to the elbow's [1]."""
        self._grid: Candidates | None = None
        # Joints of a wrist have one origin: that is one point.
        self._between: list[int] = []
        origins = self._frames(np.zeros((1, len(names))))[0, :, :, 3]
        for j in range(self._elbow, len(names)):
            last = origins[self._between[-1]] if self._between else np.full(3, np.inf)
            if np.linalg.norm(origins[j] - last) > DISTINCT:
                self._between.append(j)

    def of(self, q: Array) -> Array:
        """Return the critical points (s, m, 3) at postures q (s, n): shoulder, elbow, …, tool."""
        frames = self._frames(q)
        tip = self._frames(q, whole=True)[:, self._body - 1]
        tool = np.einsum("sij,j->si", tip[:, :, :3], self._T_tool.p) + tip[:, :, 3]
        between = [frames[:, j, :, 3] for j in self._between]
        return np.stack([frames[:, self._shoulder, :, 3], *between, tool], axis=1)

    def beyond_elbow(self, q: Array) -> Array:
        """Return the critical points behind the elbow (m − 2, 3) as the elbow's joint sees them."""
        frame = self._frames(q[None])[0, self._elbow]
        seen: Array = (self.of(q[None])[0, 2:] - frame[:, 3]) @ frame[:, :3]
        return seen

    def _frames(self, q: Array, *, whole: bool = False) -> Array:
        """Return the frames (s, n, 3, 4) of the arm's joints at q (s, n); of all, if `whole`."""
        every = np.zeros((len(q), self._n))
        every[:, self.arm] = q
        frames = self._forest.frames(every, self._foot)
        return frames if whole else frames[:, self.arm]

    @property
    def grid(self) -> Candidates:
        """The grid of postures; made once."""
        if self._grid is None:
            axes = []
            for low, high, step in zip(
                self.lower[: self.lead], self.upper[: self.lead], _steps(self.lead), strict=True
            ):
                first, last = max(low, -np.pi), min(high, np.pi - 0.5 * step)
                axes.append(np.arange(np.ceil(first / step), np.floor(last / step) + 1) * step)
            q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, self.lead)
            whole = np.zeros((len(q), len(self.lower)))
            whole[:, : self.lead] = q
            frames = self._frames(whole)[:, self._elbow]
            found = Candidates(q, frames[:, :, 3].copy(), frames[:, :, :3].copy())
            self._grid = Candidates(*(each[found.elbow[:, 2] > LOWEST] for each in found))
        return self._grid


def arm_joints(part: Cell) -> list[int]:
    """Return which joints of a mechanism are the arm's: neither wheels nor what only sweeps."""
    mechanism = part.config.mechanism
    return [
        i for i, joint in enumerate(part.robot.joints) if joint.name not in mechanism.beside_chain
    ]


def _steps(lead: int) -> Array:
    """Return the steps of the grid; joints of an arm with fewer are the last ones' like."""
    return STEPS[:lead] if lead <= len(STEPS) else np.full(lead, np.radians(30.0))
