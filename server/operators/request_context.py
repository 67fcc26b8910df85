"""The state of the daemon that a request may depend on."""

from collections.abc import Callable
from dataclasses import dataclass

from ..control.spatial import Array, Pose
from ..mode import Mode
from ..perception.cameras import VisionTracker
from ..perception.moving_frames import FrameTracker
from ..perception.obstacle_map import ObstacleMap
from .admission import Instant


@dataclass(frozen=True)
class RequestContext:
    """State of mode, sensors and frames in the tick that answers a request."""

    now: Instant
    mode: Mode
    unloaded: Array | None
    """Sensor reading less the payload's weight, averaged (6,) [N, N·m]; None when stale."""
    still: bool
    """The arm stood while that was averaged, and nothing else was asked of it."""
    essential_stale: tuple[str, ...]
    gain_bound: Callable[[str, tuple[float, ...]], str | None]
    """Why a source's gains would be unstable, or None."""
    vision: VisionTracker
    """What the cameras see."""
    obstacles: ObstacleMap
    """What is known of obstacles."""
    moving_frames: FrameTracker
    """Where the frames are that may move."""
    T_world_mrf: Pose | None = None
    """Where the command has the MRF; None before the joints were heard."""
    T_wrist_mrf: Pose | None = None
    """The MRF that this is; None: the one that is in force."""
    touched: bool = False
    """True while something unseen pushes the arm, which stopped for it."""
    drives_off: bool = True
    """All drives have said that they are off, after what they were last told."""

    def placed(self, T_wrist_mrf: Pose) -> Pose | None:
        """Return where the command has an MRF that may be a new one since; None: nowhere yet."""
        T, then = self.T_world_mrf, self.T_wrist_mrf
        if T is None or then is None or then is T_wrist_mrf:
            return T
        return T @ (then.inverse() @ T_wrist_mrf)
