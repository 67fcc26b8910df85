"""Contour message: obstacles ahead of the arm, from the scanner's process to the daemon."""

from typing import Annotated, Final, Literal

from pydantic import Field, field_validator, model_validator

from ..messages import Angle, Count, Message

NOTHING: Final = 0xFFFF
"""Nothing is in a cell: no distance, and not 0 either."""


class ContourNews(Message):
    """The contour ahead of the arm, and the reflex to it; news of a sensor, not an order.

    `tick` is the telemetry tick in which the newest scan ended. `rows` times `columns` cells of
    `cell` [m] side by side, right to left, from the foot upwards, each two bytes, the lower one
    first: how far ahead of the foot the nearest obstacle is [mm], 65535 for nothing (Zhang et al.
    2013, eq. 11).

    `posture` is the arm's joints [rad] that it should take to pass, without wheels and scanner,
    none where it may stay as it is; `most_speed` [m/s] bounds how fast the base may drive ahead,
    none: as it likes; `most_speed_back` the same back over ground that was seen. `phase` is that of
    the passage, `reason` why there is no way.
    """

    tick: Count
    rows: int = Field(ge=1, le=250)
    columns: int = Field(ge=1, le=500)
    cell: float = Field(gt=0, le=1)
    nearest_mm: bytes = Field(max_length=3200)
    phase: Literal["clear", "undecided", "folding", "folded", "returning", "refused"]
    reason: Annotated[str, Field(max_length=64, pattern=r"^[a-z0-9_]*$")] = ""
    posture: tuple[Angle, ...] | None = Field(None, max_length=64)
    most_speed: float | None = Field(None, ge=0, le=100)
    most_speed_back: float = Field(0.0, ge=0, le=100)

    @model_validator(mode="after")
    def _is_whole(self) -> "ContourNews":
        if len(self.nearest_mm) != 2 * self.rows * self.columns:
            raise ValueError(
                f"nearest_mm has {len(self.nearest_mm)} bytes: must be 2 for each of "
                f"{self.rows} times {self.columns} cells"
            )
        return self


MOST_RAYS: Final = 1082
"""Rays of a scan at most [1]."""


class ScanPoints(Message):
    """Points of one laser scan, for people's eyes and for records: the daemon does not read it.

    `points_mm` has x, y, z of each ray with an echo, the arm's own bridged, by the odometry in
    World [mm], each four bytes, signed, the lowest first. `tick` is the telemetry tick in which
    the scan ended, or the newest before.
    """

    tick: Count
    points_mm: bytes = Field(max_length=12 * MOST_RAYS)

    @field_validator("points_mm")
    @classmethod
    def _are_points(cls, value: bytes) -> bytes:
        if len(value) % 12:
            raise ValueError(f"points_mm has {len(value)} bytes: must be 12 for each point")
        return value


__all__ = ["MOST_RAYS", "NOTHING", "ContourNews", "ScanPoints"]
