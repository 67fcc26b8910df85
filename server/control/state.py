"""What goes into a tick, what it remembers, and what comes out.

Time is an input. All values are immutable by agreement: a tick builds new ones.
"""

from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np

from .frames import Array, Pose
from .sources.force import ForceState
from .sources.joystick import JoystickState
from .sources.position import PathGoal, PositionState
from .sources.vision import ViewGoal, VisionState
from .trajectory import Motion, Stop


class Intent(Enum):
    """What the daemon's mode lets the tick do."""

    SEED = auto()
    """Drives are not enabled: the command is where the joints are."""
    MOVE = auto()
    """Sources and goals act."""
    STOP = auto()
    """The stored, verified stop runs out."""
    HOLD = auto()
    """Stand; bleed off contact beyond the threshold."""


@dataclass(frozen=True)
class StickCommand:
    """A stick twist u (6,) in the axes that `R_world_axes` (3, 3) maps to World."""

    twist: Array
    R_world_axes: Array


@dataclass(frozen=True)
class Settings:
    """What an operator may change while running; the tick ramps every change."""

    gains: dict[str, Array]
    """Effective gain (6,) of each source by name; zeros where it is switched off."""
    T_wrist_mrf: Pose
    T_world_crf: Pose
    wrench_bias: Array
    """Sensor reading without load, Sensor axes, sign of the exerted wrench (6,) [N, N·m]."""
    speed_factor: float = 1.0


@dataclass(frozen=True)
class Inputs:
    """Everything that one tick may look at."""

    time_s: float
    intent: Intent
    q_measured: Array
    settings: Settings
    energised: Array | None = None
    """Which drives (n,) are already on while the arm is being enabled: they keep their command."""
    wrench_sensor: Array | None = None
    """What the arm exerts, at and in the Sensor frame (6,) [N, N·m]; None when stale."""
    stick: StickCommand | None = None
    jog: Array | None = None
    goal: PathGoal | None = None
    view: ViewGoal | None = None
    """Where the desired view is; None without one, or when pictures are stale."""
    posture: Array | None = None
    at_posture: bool = False
    """A posture was reached and nothing was asked for since: no self-motion leads away from it."""
    wrench_desired: Array = field(default_factory=lambda: np.zeros(6))
    """Wrench to exert, at and in the MRF (6,) [N, N·m]."""


@dataclass(frozen=True)
class Memory:
    """What one tick hands to the next."""

    motion: Motion
    """Commanded joints: what the drives were last told to reach."""
    stop: Stop
    """The verified way to rest from `motion`."""
    sent: tuple[Array, Array, Array]
    """The last three commanded postures, newest first."""
    gains: dict[str, Array]
    joystick: JoystickState
    position: PositionState
    vision: VisionState
    force: ForceState
    hold: Array | None = None
    """Where the Wrist was in World when HOLD began (3,) [m]."""
    bleeding: bool = False


@dataclass(frozen=True)
class Output:
    """What one tick decided, and why."""

    q: Array
    """Joint command (n,) [rad]."""
    dq: Array
    refusal: str | None
    """Why the gate refused the command; the drives must quick-stop then."""
    at_rest: bool
    following_error: Array
    T_world_mrf: Pose
    T_world_mrf_measured: Pose
    wrench_mrf: Array | None
    twists: dict[str, Array]
    """Each source's twist of the MRF, World axes (6,)."""
    twist: Array
    """Their sum, before limiting."""
    scale: float
    """Share of the asked tool motion that was granted, 0 to 1."""
    limits: tuple[str, ...]
    """Names of what limited this tick."""
    sigma_min: float
    at_goal: bool
    """True when a position or posture goal is reached."""
    bleeding: bool = False
