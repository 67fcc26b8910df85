"""Message of a camera's process for people: one small picture."""

from pydantic import Field

from ..messages import Count, Message
from .sightings import CameraName

LARGEST_JPEG = 7600
"""With it a message still arrives whole in one batch of a session [B]."""


class CameraPicture(Message):
    """A camera's picture as JPEG, small enough to look at beside everything else.

    `tick` is the telemetry tick in which it was exposed.
    """

    camera: CameraName
    tick: Count
    jpeg: bytes = Field(min_length=1, max_length=LARGEST_JPEG)
