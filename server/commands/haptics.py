"""The operator's master: clutch and scale of its motion."""

import math
from dataclasses import dataclass

import numpy as np

from ...config.schema.cell import CellConfig
from ...protocols.messages.messages import ClutchRequest, MasterPose
from ..control.spatial import Array, Pose, pose_error, rotation_exp, rotation_log, rotation_rpy
from ..reflection import Reflector
from ..refusals import Refused, Why

# --- The operator's master: clutch and scale, for its stick (rates) and for its pose --------------
#
# In pose mode, the increments of the master's pose from one message to the next, while the
# clutch is engaged, move a target pose of the MRF. Engaging takes the target from where the MRF
# is, so the master's own place never matters; a new scale applies to later increments only, so
# the target never jumps; and silence lets go, so that what the master did meanwhile does not
# count.

SLIP = (0.05, 0.3)
"""The target leads the MRF by no more than this [m], [rad]; what is beyond, slips."""

IMPLAUSIBLE = (0.1, 0.5)
"""A master does not move this far between two messages [m], [rad]."""


@dataclass
class Master:
    """Clutch and scale of the master, and the target that its pose has led to."""

    engaged: bool = True
    translation: float = 1.0
    rotation: float = 1.0
    waiting: bool = True
    """The pose mode waits for a request to engage."""
    target: Pose | None = None
    """Where the master has led the MRF in World; None while it leads nowhere."""
    _last: Pose | None = None
    _since_s: float = 0.0

    def set(self, request: ClutchRequest) -> None:
        """Put a request in force."""
        if request.translation is not None:
            self.translation = request.translation
        if request.rotation is not None:
            self.rotation = request.rotation
        if request.engaged is not None:
            self.engaged = request.engaged
            self.waiting = not request.engaged
            if not request.engaged:
                self._let_go()

    def wait(self) -> None:
        """Let go, until engaged anew: something else took over."""
        self.waiting = True
        self._let_go()

    def carry(self, T_old_new: Pose) -> None:
        """Lead a new MRF to where the old one was led, the body to the same place."""
        if self.target is not None:
            self.target = self.target @ T_old_new

    def scaled(self, twist: Array) -> Array | None:
        """Return the stick's twist (6,) as the clutch lets it through, None when disengaged."""
        if not self.engaged:
            return None
        return np.asarray(twist * np.array((*[self.translation] * 3, *[self.rotation] * 3)))

    def take(
        self,
        message: MasterPose,
        now_s: float,
        axes: Array,
        T_world_mrf: Pose,
        reflector: Reflector | None = None,
    ) -> bool:
        """Move the target by what the master did since its last message; return whether it leads.

        `axes` (3, 3) lays the device's base axes into World. Where forces are reflected, only what
        the arm's port admits moves the target. Raises `Refused` for a motion that no hand makes;
        the next message counts from there.
        """
        if self.waiting or not self.engaged:
            return False
        pose = Pose(rotation_rpy(*message.rpy), np.array(message.xyz))
        last, self._last, self._since_s = self._last, pose, now_s
        if last is None or self.target is None:
            self.target = T_world_mrf
            if reflector is not None:
                reflector.engage(message.handle)
            return True
        moved, turned = pose.p - last.p, rotation_log(pose.R @ last.R.T)
        if _size(moved) > IMPLAUSIBLE[0] or _size(turned) > IMPLAUSIBLE[1]:
            raise Refused(
                Why.OUT_OF_RANGE,
                f"the master moved {_size(moved):.3f} m and {_size(turned):.2f} rad at once",
            )
        if reflector is not None:
            step = reflector.admit(np.concatenate([moved, turned]), message.handle)
            moved, turned = step[:3], step[3:]
        R = rotation_exp(axes @ (self.rotation * turned)) @ self.target.R
        self.target = _within(
            Pose(R, self.target.p + axes @ (self.translation * moved)), T_world_mrf
        )
        return True

    def expired(self, now_s: float, timeout_s: float) -> bool:
        """Let go if the master fell silent while it led; return whether it did."""
        if self._last is None or now_s - self._since_s <= timeout_s:
            return False
        self._let_go()
        return True

    def _let_go(self) -> None:
        self._last = self.target = None


def _within(target: Pose, T: Pose) -> Pose:
    """Return the target, brought to where it leads T by no more than it may."""
    lead = pose_error(target, T)
    far, turned = _size(lead[:3]), _size(lead[3:])
    if far <= SLIP[0] and turned <= SLIP[1]:
        return target
    p = T.p + lead[:3] * min(1.0, SLIP[0] / max(far, 1e-12))
    R = rotation_exp(lead[3:] * min(1.0, SLIP[1] / max(turned, 1e-12))) @ T.R
    return Pose(R, p)


def _size(vector: Array) -> float:
    return math.sqrt(float(vector @ vector))


def reflector_of(config: CellConfig) -> Reflector | None:
    """Return what reflects forces in a cell; None where nothing does."""
    sensor = config.mechanism.force_torque
    if config.reflection is None or sensor is None:
        return None
    return Reflector(config.reflection, sensor.stiffest_environment, config.timing.period_s)
