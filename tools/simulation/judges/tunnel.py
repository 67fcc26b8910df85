"""Judge of an arm in tunnels: where its links truly are, and what they press on the walls."""

from typing import Any

import numpy as np

from ....config.load import Cell
from ....protocols.messages.rig import RigTruth
from ...oracle.arm import OracleArm
from ...oracle.tunnel import Tunnel


class TunnelJudge:
    """Judges every tick by the physics; idle for a cell without a backbone."""

    def __init__(self, cell: Cell) -> None:
        backbone = cell.config.mechanism.backbone
        self._arm = None if backbone is None else OracleArm.of(cell)
        self._tunnel = None if backbone is None else Tunnel(backbone)
        self.centre_error = 0.0
        """The farthest that a link was off the centre line inside [m]."""
        self.insertion = self.deepest = 0.0
        """How far in along the centre line the tip is, and has been [m]."""
        self.wall_force = 0.0
        """The greatest force on walls and what else stands around, in any physics step [N]."""

    def judge(self, truth: RigTruth) -> None:
        """Take in a tick."""
        if self._arm is None or self._tunnel is None:
            return
        links = self._arm.frames(np.array(truth.q))[1:, :3, 3]
        self.insertion = self._tunnel.along(links[-1])
        self.deepest = max(self.deepest, self.insertion)
        points = np.concatenate((links, 0.5 * (links[1:] + links[:-1])))
        self.centre_error = max(self.centre_error, self._tunnel.off_centre(points))
        arms = truth.arms.values()
        self.wall_force = max(self.wall_force, *(arm.contact_peak for arm in arms))

    def figures(self) -> dict[str, Any]:
        """Return what a simulation's JSON tells; nothing for a plain arm."""
        if self._tunnel is None:
            return {}
        return {
            "insertion_m": self.insertion,
            "deepest_m": self.deepest,
            "centre_error_m": self.centre_error,
            "wall_force_n": self.wall_force,
        }
