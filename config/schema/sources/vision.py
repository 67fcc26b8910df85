"""Schema of the source that keeps a camera's view."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from ..section import Name, PoseSection
from .source import SourceSection

Gain = Annotated[float, Field(ge=0, le=100)]


class VisionSection(SourceSection):
    """A camera's view: rate = K_V (desired view − seen view), per axis of the Lens."""

    NEEDS: ClassVar[Literal["camera"]] = "camera"
    ERROR_GAIN: ClassVar[str | None] = "K_V"

    enabled: bool = Field(False, description="switch at start")
    gain: tuple[Gain, Gain, Gain, Gain, Gain, Gain] = Field(
        (1.0,) * 6, description="K_V: error to rate [1/s]"
    )
    camera: Name | None = Field(None, description="whose view; none: the first camera's")
    view: PoseSection | None = Field(
        None, description="desired tag in the Lens at start; none: until a view is stored"
    )
    speed: float = Field(0.15, gt=0, le=5, description="largest rate of the Lens [m/s]")
    angular_speed: float = Field(0.5, gt=0, le=10, description="the same [rad/s]")
    timeout_s: float = Field(
        0.25, gt=0, le=5, description="a picture older than this is stale: the source fades [s]"
    )
    least_quality: float = Field(0.3, ge=0, le=1, description="pictures below are refused [1]")
    jump_speed: float = Field(
        0.5, gt=0, le=100, description="faster than this no seen target moves [m/s]"
    )
    jump_angular_speed: float = Field(2.0, gt=0, le=100, description="the same [rad/s]")
    jump_slack: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] = Field(
        (0.02, 0.12), description="difference of two pictures that is still noise [m], [rad]"
    )
    smoothing_s: float = Field(
        0.25, ge=0, le=2, description="time constant of the filter over the seen target [s]"
    )
