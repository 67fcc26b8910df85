"""Goals: where the arm is to go. They hold until they are replaced, cancelled or reached."""

from dataclasses import replace

from ...protocols.messages.motion import PathRequest
from ..control.spatial import Array, Pose
from ..control.task.paths.goals import Goal, Pursuit
from ..refusals import Refused, Why


class Goals:
    """The newest goal, of which there is one: a path, the pursuit of a master, or a posture."""

    def __init__(self, T_wrist_mrf: Pose) -> None:
        self.goal: Goal | None = None
        """Path or pursuit; poses in it are in World, or on `ground`."""
        self.ground = "world"
        """The frame that the goal is measured against."""
        self.T_wrist_goal = T_wrist_mrf
        """The point of the tool that is led to the goal: the MRF that it was commanded for."""
        self.paused = False
        self.posture: Array | None = None
        """Joint angles (n,) to go to [rad]."""
        self.posture_reached = False
        self.idle = True
        """Nothing was asked for since the arm was enabled."""
        self._serial = 0

    @property
    def at_rest(self) -> bool:
        """True where no self-motion is to lead the arm away: at a posture, or not asked at all."""
        return self.idle or self.posture_reached

    @property
    def pursuing(self) -> bool:
        """True while a master's pose leads the MRF."""
        return isinstance(self.goal, Pursuit)

    def next_serial(self) -> int:
        """Return a number that no goal has had."""
        self._serial += 1
        return self._serial

    def lead_to(self, goal: Goal, ground: str, T_wrist_goal: Pose) -> None:
        """Replace the goal by a path or a pursuit on a ground, for a point of the tool."""
        self.drop()
        self.goal, self.ground, self.T_wrist_goal = goal, ground, T_wrist_goal

    def take_posture(self, q: Array) -> None:
        """Replace the goal by a posture (n,) [rad]."""
        self.drop()
        self.posture = q

    def pursue(self, target: Pose | None) -> None:
        """Let a pursuit lead to a new target; None: nowhere, come to rest."""
        if isinstance(self.goal, Pursuit):
            self.goal = replace(self.goal, T_world_target=target)

    def drop(self) -> None:
        """Drop the goal, whatever it is."""
        self.goal = self.posture = None
        self.posture_reached = self.paused = False

    def leave_posture(self) -> None:
        """Give up a posture for a motion that begins where the arm is now."""
        self.posture, self.posture_reached = None, False

    def finish_posture(self) -> None:
        """End a posture that is reached: the other sources may act again."""
        self.posture, self.posture_reached = None, True

    def led_by_hand(self) -> None:
        """Note that a hand moves the tool, as a stick does: the arm is at no posture any more."""
        self.posture_reached = self.idle = False

    def control_path(self, request: PathRequest) -> None:
        """Pause, resume or abort the path. Raises `Refused` where none is under way."""
        if self.goal is None or self.pursuing:
            raise Refused(Why.NOT_NOW, "no path is under way")
        if request.action == "abort":
            self.goal = None
        self.paused = request.action == "pause"

    def restart_path(self) -> None:
        """Let the path to the target begin anew from where the arm is."""
        if self.goal is not None:
            self.goal = replace(self.goal, attempt=self.goal.attempt + 1)

    def placed_target(self, T_wrist_mrf: Pose) -> tuple[str, Pose] | None:
        """Return the target's ground and the pose of an MRF there; None without a target."""
        T = None if self.goal is None else self.goal.T_world_target
        if T is None or T_wrist_mrf is self.T_wrist_goal:
            return None if T is None else (self.ground, T)
        return self.ground, T @ (self.T_wrist_goal.inverse() @ T_wrist_mrf)
