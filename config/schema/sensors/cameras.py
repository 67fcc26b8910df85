"""Schema of cameras, and of tags in the virtual world."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..section import Name, PoseSection, Section, Vector3

TagFamily = Literal["4x4_50", "5x5_50", "6x6_50", "apriltag_36h11"]
Pixels = Annotated[float, Field(gt=0, le=1e5)]


class CameraSection(Section):
    """A camera that looks for one planar tag; fixed to the Wrist, to World or to Base.

    The Lens frame has its origin in the pinhole, x to the right of the picture, y down, z ahead.
    """

    name: Name = Field(description="name of the camera")
    T_wrist_lens: PoseSection | None = Field(
        None, description="Lens in the Wrist, of a carried camera"
    )
    T_world_lens: PoseSection | None = Field(
        None, description="Lens in World, of one beside the arm"
    )
    T_base_lens: PoseSection | None = Field(
        None, description="Lens in Base, of one that stands beside the arm on what carries both"
    )
    device: str | None = Field(
        None, description="index, path or URL that OpenCV opens; none: rendered by the rig"
    )
    size: tuple[Annotated[int, Field(ge=16, le=8192)], Annotated[int, Field(ge=16, le=8192)]] = (
        Field((640, 480), description="width and height of a picture [px]")
    )
    focal: tuple[Pixels, Pixels] = Field((560.0, 560.0), description="fx, fy [px]")
    principal: tuple[Pixels, Pixels] | None = Field(
        None, description="cx, cy, pixel centres at whole numbers; none: the middle [px]"
    )
    distortion: tuple[float, float, float, float, float] = Field(
        (0.0,) * 5, description="k1, k2, p1, p2, k3 as OpenCV has them [1]"
    )
    rate_hz: float = Field(20.0, gt=0, le=200, description="pictures per second [Hz]")
    latency_s: float = Field(
        0.05,
        ge=0,
        le=1,
        description="from exposure until the daemon hears: simulated for a rendered camera, "
        "taken off the stamp for a real one [s]",
    )
    tag: int = Field(0, ge=0, le=586, description="id of the tag that it looks for [1]")
    tag_size: float = Field(0.1, gt=0, le=2, description="side of the tag's black square [m]")
    family: TagFamily = Field("5x5_50", description="which family of tags it is one of")
    video_hz: float = Field(
        20.0,
        ge=1,
        le=60,
        description="pictures per second of its video, which is made while somebody looks at it "
        "large; sightings keep their rate [Hz]",
    )
    video_width: int = Field(
        1280, ge=64, le=1920, description="its video is scaled down to so wide, if wider [px]"
    )
    video_kbit_s: int = Field(
        2000, ge=100, le=8000, description="most of its video that is sent [kbit/s]"
    )

    @model_validator(mode="after")
    def _one_place(self) -> "CameraSection":
        places = (self.T_wrist_lens, self.T_world_lens, self.T_base_lens)
        if sum(place is not None for place in places) != 1:
            raise ValueError("give one of T_wrist_lens, T_world_lens, T_base_lens")
        return self

    @property
    def on(self) -> Literal["wrist", "world", "base"]:
        """The frame that it is fixed to."""
        if self.T_wrist_lens is not None:
            return "wrist"
        return "base" if self.T_world_lens is None else "world"

    @property
    def place(self) -> PoseSection:
        """The Lens in that frame."""
        return self.T_wrist_lens or self.T_world_lens or self.T_base_lens or PoseSection()

    @property
    def centre(self) -> tuple[float, float]:
        """The principal point [px]."""
        if self.principal is not None:
            return self.principal
        return (self.size[0] / 2 - 0.5, self.size[1] / 2 - 0.5)


class RigTagSection(Section):
    """A planar tag of the virtual world: x to the right of its picture, y up, z out of its face."""

    name: Name = Field(description="name that faults use")
    T_world_tag: PoseSection | None = Field(
        None, description="its pose in World, if it stands there"
    )
    T_wrist_tag: PoseSection | None = Field(
        None, description="its pose in the Wrist, if it is carried"
    )
    tag: int = Field(0, ge=0, le=586, description="its id [1]")
    size: float = Field(0.1, gt=0, le=2, description="side of the black square [m]")
    family: TagFamily = Field("5x5_50", description="family of tags")
    colour: Vector3 = Field((0.85, 0.85, 0.85), description="of the panel behind it, RGB [1]")

    @model_validator(mode="after")
    def _one_place(self) -> "RigTagSection":
        if (self.T_world_tag is None) == (self.T_wrist_tag is None):
            raise ValueError("give either T_world_tag or T_wrist_tag")
        return self
