"""Refusals of well-formed commands and requests, by reason."""

from enum import StrEnum
from traceback import extract_tb
from types import TracebackType
from typing import Final


class Why(StrEnum):
    """Reason for a refusal, as it is told to programs."""

    NO_LEASE = "no_lease"
    WRONG_PROOF = "wrong_proof"
    WRONG_KEY = "wrong_key"
    OLD_EPOCH = "old_epoch"
    OUT_OF_ORDER = "out_of_order"
    OLD_PICTURE = "old_picture"
    """Of the telemetry: the command was based on too old a snapshot."""
    FUTURE_PICTURE = "future_picture"
    BEFORE_ENABLE = "before_enable"
    NOT_ENABLED = "not_enabled"
    NOT_NOW = "not_now"
    OUT_OF_RANGE = "out_of_range"
    WRONG_JOINTS = "wrong_joints"
    NO_SPARE_JOINT = "no_spare_joint"
    UNKNOWN_POSTURE = "unknown_posture"
    UNKNOWN_PAYLOAD = "unknown_payload"
    UNKNOWN_SOURCE = "unknown_source"
    UNKNOWN_OBJECTIVE = "unknown_objective"
    LEASE_TAKEN = "lease_taken"
    PROTECTIVE_STOP = "protective_stop"
    NOT_YOURS = "not_yours"
    UNKNOWN_TASK = "unknown_task"
    UNKNOWN_MECHANISM = "unknown_mechanism"
    UNKNOWN_CAMERA = "unknown_camera"
    UNKNOWN_OBSTACLE = "unknown_obstacle"
    FIXED_OBSTACLE = "fixed_obstacle"
    ANOTHERS_OBSTACLE = "anothers_obstacle"
    UNNAMED_SENDER = "unnamed_sender"
    TOO_MANY_OBSTACLES = "too_many_obstacles"
    UNKNOWN_FRAME = "unknown_frame"
    SENSOR_STALE = "sensor_stale"
    TOUCHED = "touched"
    STILL_WRONG = "still_wrong"
    OVERLOADED = "overloaded"
    UNSTABLE_GAIN = "unstable_gain"
    UNSTABLE_FRAME = "unstable_frame"
    UNSTABLE_PAYLOAD = "unstable_payload"
    HANDLER_RAISED = "handler_raised"
    """An error of this program, not of the message's sender."""


class Refused(Exception):
    """A command or request was refused: `reason` for programs, the text for people."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason
        self.detail = detail


class _RefusingErrors:
    """Refuses a message in whose handling anything is raised: one message does not stop the arm.

    Raises `Refused`, with the error and where it was raised. What the handler did before holds.
    """

    def __enter__(self) -> None: ...

    def __exit__(
        self,
        _: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None or isinstance(error, Refused) or not isinstance(error, Exception):
            return
        last = extract_tb(trace)[-1]
        place = f"{last.filename.rpartition('/')[2]}:{last.lineno}"
        words = f"{type(error).__name__}: {error}"
        raise Refused(Why.HANDLER_RAISED, f"{words[:300]} ({place})") from error


refusing_errors: Final = _RefusingErrors()
"""Surrounds the handling of a message."""
