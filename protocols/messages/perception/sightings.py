"""Messages of a camera's process, and an operator's requests about views."""

from typing import Annotated

from pydantic import Field, model_validator

from ..messages import Angle, Count, Message, Metres, TaskCommand

CameraName = Annotated[str, Field(min_length=1, max_length=32)]
PoseVector = tuple[Metres, Metres, Metres, Angle, Angle, Angle]
Pixels = Annotated[float, Field(ge=0, le=1e4)]


class Sighting(Message):
    """A camera's view of a tag in one picture; a sensor's reading, not an order.

    `tick` is the telemetry tick in which the picture was exposed. `poses` are the one or two poses
    `[x, y, z, roll, pitch, yaw]` [m, rad] of the tag in the Lens that explain its corners, the
    better one first, `errors_px` their reprojection errors; none where the tag is not to be seen.
    `quality` is from 0 to 1.
    """

    camera: CameraName
    tick: Count
    poses: tuple[PoseVector, ...] = Field((), max_length=2)
    errors_px: tuple[Pixels, ...] = Field((), max_length=2)
    quality: float = Field(0.0, ge=0, le=1)

    @model_validator(mode="after")
    def _an_error_each(self) -> "Sighting":
        if len(self.poses) != len(self.errors_px):
            raise ValueError("give one error for each pose")
        return self


class StoreView(TaskCommand):
    """Makes what a camera sees now the view that the vision source keeps.

    Without a camera's name: of the camera whose view is kept now.
    """

    camera: CameraName | None = None
