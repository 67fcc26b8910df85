"""Messages about frames that move, and about frames that are redefined.

The envelope, units and conventions are those of `messages/messages.py`.
"""

from typing import Literal

from pydantic import Field, model_validator

from ..messages import Attitude, Count, Frame, Message, Place, TaskCommand, Twist


class FrameNews(Message):
    """Where a frame was; a sensor's reading, not an order.

    `tick` is the telemetry tick in which it was measured. `xyz` [m] and `rpy` [rad] are its pose in
    `seen_from`, `twist` [m/s, rad/s] its twist seen from there, at its origin, in that frame's
    axes, where it is measured; else it is found from the poses. `quality` is from 0 to 1. What is
    faster, accelerates more or is further away than the cell says is not believed.
    """

    name: Literal["base", "carrier"]
    tick: Count
    xyz: Place
    rpy: Attitude
    twist: Twist | None = None
    seen_from: Literal["world", "base"] = "world"
    quality: float = Field(1.0, ge=0, le=1)
    heading: bool = False
    """Only the yaw of `rpy` was measured, as by a gyroscope on a base with wheels."""

    @model_validator(mode="after")
    def _not_from_itself(self) -> "FrameNews":
        if self.name == self.seen_from:
            raise ValueError("base is not seen from base")
        return self


class FrameRequest(TaskCommand):
    """Redefines the MRF or the CRF; nothing moves because of it.

    `xyz` [m] and `rpy` [rad] are its pose in `relative_to`, as that frame is now: by default the
    Wrist for the MRF, World for the CRF. So *here* is a pose of zero: the CRF relative to "mrf" is
    put where the tool is, the MRF relative to "crf" where the CRF is. With `origin_only` the frame
    keeps its axes, and what changes is the point that rotations turn about.

    The CRF then moves with `moves_with`; what is not given stays. A goal stays on what it was
    measured against, and goes on leading the point of the tool that was the MRF then; a master
    leads the new one. A desired wrench stays the same load.
    """

    frame: Literal["mrf", "crf"]
    xyz: Place = (0.0, 0.0, 0.0)
    rpy: Attitude = (0.0, 0.0, 0.0)
    relative_to: Frame | None = None
    origin_only: bool = False
    moves_with: Literal["world", "base", "carrier"] | None = None

    @model_validator(mode="after")
    def _fits(self) -> "FrameRequest":
        if self.frame == "mrf" and self.moves_with is not None:
            raise ValueError("the MRF moves with the Wrist")
        return self


class RigMotion(Message):
    """Tells the rig how the platform under the arm, or the Carrier, moves from now on.

    `twist` [m/s, rad/s] is constant, `sway` [m, rad] the amplitude of a sine about its place, both
    in World. They are taken up and laid down smoothly.
    """

    target: Literal["platform", "carrier"]
    twist: Twist = (0.0,) * 6
    sway: Twist = (0.0,) * 6
    period_s: float = Field(4.0, ge=0.2, le=600)
