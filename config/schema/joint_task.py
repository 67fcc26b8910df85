"""Schema of a task that several mechanisms hold together."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, model_validator

from .mechanism import PayloadSection
from .section import Name, PoseSection, Section
from .sources import ScheduleSection, SourcesSection

Weight = Annotated[float, Field(ge=1e-3, le=1e3)]
"""Beyond, one arm carries all: what is left of the others' shares is rounding."""

MOST_ARMS = 8
"""Mechanisms that hold one payload at most [1]."""

Weights = Annotated[
    tuple[Weight, Weight, Weight, Weight, Weight, Weight],
    Field(description="forces x, y, z, then moments x, y, z"),
]


class JointTaskSection(Section):
    """One payload held by several mechanisms, each by a grasp of its own."""

    name: Name = Field(description="name of the task")
    by: tuple[Name, ...] = Field(
        min_length=2, max_length=MOST_ARMS, description="mechanisms that hold the payload"
    )
    at_start: bool = Field(False, description="true: they hold it when the daemon starts")
    T_wrist_mrf: tuple[PoseSection, ...] = Field(
        description="the shared MRF in each mechanism's Wrist; an operator moves it in the first's"
    )
    payload: PayloadSection = Field(
        default_factory=PayloadSection, description="what they carry; its centre of mass in the MRF"
    )
    shares: tuple[Weights, ...] = Field(
        (),
        description="diagonals of W, one row each: the dearer, the less one carries; none: by "
        "rated_payload, 1 where a mechanism tells none",
    )
    internal_stiffness: float = Field(
        50_000.0, gt=0, le=1e8, description="what one arm feels of another over the grasps [N/m]"
    )
    internal_stiffness_rotation: float = Field(
        1000.0, gt=0, le=1e6, description="the same about a grasp [N·m/rad]"
    )
    stretch: float = Field(
        0.0005, gt=0, le=0.05, description="grasps move apart by at most, along every stop [m]"
    )
    most_internal: float = Field(
        60.0, gt=0, le=1e5, description="internal force beyond which the arms stop [N]"
    )
    most_internal_moment: float = Field(
        15.0, gt=0, le=1e4, description="the same of a moment at a grasp [N·m]"
    )
    most_internal_at_fault: float = Field(
        60.0,
        gt=0,
        le=1e5,
        description="internal force that a drive's fault, an arm's brakes or a silent bus may "
        "leave: the payload is slowed down to it [N]",
    )
    quick_stop: Literal["in_proportion", "each"] = Field(
        "in_proportion",
        description="in_proportion: drives are told ramps by which all joints come to rest "
        "together (6085h by RPDO2); each: every joint by its own quick_stop_deceleration",
    )
    T_world_crf: PoseSection = Field(
        default_factory=PoseSection, description="control reference frame in World, at start"
    )
    sources: SourcesSection = Field(
        default_factory=SourcesSection, description="who may ask for a rate"
    )
    schedules: tuple[ScheduleSection, ...] = Field(
        (), max_length=16, description="gains that change with force, distance or time"
    )

    def shared_by(self, rated: Mapping[str, float | None]) -> "JointTaskSection":
        """Return the section with shares where it has none: by the payloads [kg] that arms bear.

        `rated` has them by mechanism.
        """
        if self.shares:
            return self
        told = [rated[name] for name in self.by]
        each = [kg for kg in told if kg is not None]
        if len(each) < len(told):
            each = [1.0] * len(told)
        rows = tuple((min(1e3, max(each) / kg),) * 6 for kg in each)
        return self.model_copy(update={"shares": rows})

    @model_validator(mode="after")
    def _has_one_of_each(self) -> "JointTaskSection":
        for i, name in enumerate(self.by):
            if name in self.by[:i]:
                raise ValueError(f"by[{i}]: '{name}' holds it already")
        count = len(self.by)
        if len(self.T_wrist_mrf) != count:
            raise ValueError(
                f"T_wrist_mrf: {len(self.T_wrist_mrf)} poses for {count} mechanisms: one each"
            )
        if self.shares and len(self.shares) != count:
            raise ValueError(f"shares: {len(self.shares)} rows for {count} mechanisms: one each")
        return self
