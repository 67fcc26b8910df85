"""Contract of a compared controller."""

from typing import Protocol

from telerobot.config.load import Cell
from telerobot.server.control.spatial import Array, Pose

from ..scenes import PeerScene

CLEARANCE = 0.02
"""Distance from things that every controller is told to keep [m]."""
SELF_CLEARANCE = 0.01
"""Distance of links that every controller is told to keep [m]."""


class NoCommand(Exception):
    """The controller found no command: carries its reason. The arm stands for this period."""


class Controller(Protocol):
    """Leads one arm through one scene; a kinematic plant does exactly what it says."""

    def __init__(self, cell: Cell, scene: PeerScene) -> None:
        """Get ready: the arm stands at the scene's start."""

    def aim(self, target: Pose) -> None:
        """Take up the next target of the MRF (World)."""

    def step(self, q: Array, tick: int, reference: Pose) -> Array:
        """Return the joint angles (n,) [rad] one period after `tick`, where the arm is at q (n,).

        `reference` is where the straight path to the target has the MRF one period later. Raises
        `NoCommand`.
        """

    @staticmethod
    def settings() -> dict[str, object]:
        """Return how it is set up, by name."""
