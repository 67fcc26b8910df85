"""Fault detection: devices in trouble, drives that left Operation enabled, joints left behind."""

from collections.abc import Sequence

import numpy as np

from ..config.schema.mechanism.mechanism import DriveSection
from ..drivers.device import Cause, Trouble
from ..protocols.canopen.cia402 import DriveState
from .control.joints import Joints
from .control.spatial import Array
from .mode import Mode
from .plant import PlantReading


class FaultDetector:
    """Detects faults that call for a quick stop."""

    def __init__(self, joints: Joints, drives: Sequence[DriveSection]) -> None:
        """Build it for all joints of a cell, and their drives in the same order."""
        self._joints, self._window = joints.names, joints.following_window
        self._nodes = tuple(drive.node for drive in drives)

    def find(
        self, mode: Mode, reading: PlantReading, following_error: Array | None
    ) -> Trouble | None:
        """Return what is wrong now, or None; `following_error` (n,) is the last tick's [rad]."""
        if reading.trouble is not None or not mode.energised:
            return reading.trouble
        return self._elsewhere(mode, reading) or self._left_behind(following_error)

    def _elsewhere(self, mode: Mode, reading: PlantReading) -> Trouble | None:
        """Return which drive is not in Operation enabled, though the mode says that all are."""
        if DriveState.OPERATION_ENABLED in reading.states and len(set(reading.states)) == 1:
            return None
        j = next(i for i, s in enumerate(reading.states) if s is not DriveState.OPERATION_ENABLED)
        state = reading.states[j]
        there = "no state" if state is None else state.name.lower()
        return Trouble(
            Cause.STATE_LOST,
            self._joints[j],
            f"the mode is {mode}, the drive is in {there}",
            {"node": self._nodes[j]},
        )

    def _left_behind(self, following_error: Array | None) -> Trouble | None:
        """Return which joint is too far from its command."""
        if following_error is None:
            return None
        error = np.abs(following_error)
        if not (error > self._window).any():
            return None
        j = int(np.argmax(error / self._window))
        return Trouble(
            Cause.FOLLOWING_ERROR,
            self._joints[j],
            f"command and joint are {error[j]:.4f} rad apart, at most {self._window[j]:.4f}",
            {"node": self._nodes[j], "error_rad": float(error[j])},
        )
