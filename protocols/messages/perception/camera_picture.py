"""Messages of a camera's process for people: one small picture, and a piece of its video."""

from typing import Self

from pydantic import Field, model_validator

from ..messages import Count, Message
from .sightings import CameraName

LARGEST_JPEG = 7600
"""With it a message still arrives whole in one batch of a session [B]."""

MOST_PIECES = 16
"""Pieces of one frame; all batches that a router keeps for a link that is slow [1]."""

LARGEST_FRAME = MOST_PIECES * LARGEST_JPEG
"""Longest frame of a video [B]."""


class CameraPicture(Message):
    """A camera's picture as JPEG, small enough to look at beside everything else.

    `tick` is the telemetry tick in which it was exposed.
    """

    camera: CameraName
    tick: Count
    jpeg: bytes = Field(min_length=1, max_length=LARGEST_JPEG)


class VideoPiece(Message):
    """A piece of one frame of a camera's video: an access unit of H.264 with start codes (Annex B).

    `tick` is the telemetry tick in which it was exposed, `frame` counts the frames. The frame is
    piece 0 to `pieces` - 1, one after the other. Each frame but a key frame needs the one before
    it; a key frame begins with its parameter sets, and comes at least once a second.
    """

    camera: CameraName
    tick: Count
    frame: Count
    key: bool
    piece: int = Field(ge=0, lt=MOST_PIECES)
    pieces: int = Field(ge=1, le=MOST_PIECES)
    data: bytes = Field(min_length=1, max_length=LARGEST_JPEG)

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if self.piece >= self.pieces:
            raise ValueError(f"piece {self.piece} of {self.pieces}")
        return self
