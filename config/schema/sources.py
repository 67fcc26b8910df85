"""Schema of the sources of a task: what they have in common, one section each, and all of them."""

from collections.abc import Iterator, Set
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from .section import Name, NonNegative, PoseSection, Section, Share, Vector3, Vector6

# --- Fields that the sections of all sources have in common ---------------------------------------


class SourceSection(Section):
    """A source's switch and gain, and what they depend on."""

    NEEDS: ClassVar[Literal["force_torque", "camera", "contour"] | None] = None
    """Sensor without which it stays off."""
    ERROR_GAIN: ClassVar[str | None] = None
    """Symbol of a gain that turns an error of the pose into a rate [1/s], which the loop's delay
    bounds; None for a gain of another kind."""

    enabled: bool = Field(True, description="switch at start")
    gain: Vector6

    def lacking(self, there: Set[str]) -> Iterator[str]:  # noqa: ARG002 (most lack nothing)
        """Yield the keys whose values need what the cell has not, and what that is.

        `there` are its sensors, "force_torque", "camera" and "contour", and its moving frames.
        """
        yield from ()


# --- Schema of the source that follows a hand -----------------------------------------------------


class FollowingSection(SourceSection):
    """The tool moves as a damped mass would under the hand's force, and its attitude stays."""

    NEEDS: ClassVar[Literal["force_torque"]] = "force_torque"

    enabled: bool = Field(False, description="switch at start")
    gain: tuple[Share, Share, Share, Share, Share, Share] = Field(
        (1.0, 1.0, 1.0, 0.0, 0.0, 0.0),
        description="share of the measured force and moment that is followed, MRF axes [1]",
    )
    mass: float = Field(1.0, gt=0, le=1000, description="M_e [kg]")
    damping: float = Field(20.0, gt=0, le=1e4, description="B_e: steady speed is force / B_e")
    inertia: float = Field(1.0, gt=0, le=100, description="the same about an axis [kg·m²]")
    angular_damping: float = Field(20.0, gt=0, le=1e4, description="the same [N·m·s/rad]")
    stiffness: float = Field(
        5.0, ge=0, le=50, description="the command's error from the reference, to rate [1/s]"
    )
    deadband: float = Field(
        0.3,
        ge=0,
        le=50,
        description="force that is not followed; twice as much is, in full [N]",
    )
    moment_deadband: float = Field(0.05, ge=0, le=10, description="the same [N·m]")
    max_force: float = Field(
        30.0, gt=0, le=1000, description="more than this is followed as if it were this [N]"
    )
    max_moment: float = Field(5.0, gt=0, le=100, description="the same [N·m]")
    payload_smoothing_s: float = Field(
        0.004,
        ge=0,
        le=0.1,
        description="time constant of the force for a payload of M_e, in proportion to it [s]",
    )
    stiffest_hand: float = Field(
        300.0, gt=0, le=1e6, description="stiffness of the hand or arm that guides the tool [N/m]"
    )

    def lacking(self, there: Set[str]) -> Iterator[str]:
        """Yield that there is no force to follow."""
        if self.enabled and "force_torque" not in there:
            yield "enabled: value True: there is no [mechanism.force_torque]"


# --- Schema of force control ----------------------------------------------------------------------


class ForceSection(SourceSection):
    """Force–moment accommodation: rate = K_F (desired wrench − wrench), per axis."""

    NEEDS: ClassVar[Literal["force_torque"]] = "force_torque"

    gain: Vector6 = Field(
        (7e-4, 7e-4, 7e-4, 0.03, 0.03, 0.03), description="K_F [m/s/N, rad/s/(N·m)]"
    )
    hold_threshold: float = Field(
        30.0,
        gt=0,
        le=1e4,
        description="contact force that is bled off in HOLD, and stops a jog or posture [N]",
    )
    hold_leash: float = Field(
        0.02, ge=0, le=0.2, description="largest tool travel while bleeding off [m]"
    )
    most_press: float = Field(
        100.0,
        gt=0,
        le=1e4,
        description="force that stick, goals and other sources press with at most, beside what is "
        "wanted [N]",
    )


# --- Schema of the operator's stick ---------------------------------------------------------------


class JoystickSection(SourceSection):
    """Rates from a stick, times a gain per axis (K_HC)."""

    gain: Vector6 = Field((1.0,) * 6, description="K_HC [1]")
    braking: float = Field(
        1.0,
        ge=1,
        le=5,
        description="a released stick comes to rest so many times as quickly as it sets out [1]",
    )


# --- Schema of position control -------------------------------------------------------------------


class PositionSection(SourceSection):
    """Target poses: a jerk-limited path, followed with error feedback (K_P)."""

    ERROR_GAIN: ClassVar[str | None] = "K_P"

    gain: Vector6 = Field((2.0,) * 6, description="K_P: error to rate [1/s]")
    speed: float = Field(0.15, gt=0, le=5, description="path speed [m/s]")
    angular_speed: float = Field(0.5, gt=0, le=10, description="path speed [rad/s]")


# --- Schema of the source that folds an arm to what a scanner sees ahead --------------------------

ReflexGain = Annotated[float, Field(ge=0, le=1)]


class ReflexSection(SourceSection):
    """Folding to pass below what is ahead: the tool's part of it, per axis of World."""

    NEEDS: ClassVar[Literal["contour"]] = "contour"

    gain: tuple[ReflexGain, ReflexGain, ReflexGain, ReflexGain, ReflexGain, ReflexGain] = Field(
        (1.0,) * 6,
        description="share of the tool's motion; 0: the tool stands, the elbow folds [1]",
    )


# --- Schema of a virtual fixture ------------------------------------------------------------------

AxisGain = Annotated[float, Field(ge=0, le=100)]
NoGain = Annotated[float, Field(ge=0, le=0)]
"""Of an axis that a source never asks for."""


def _somewhere(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    if sum(x * x for x in axis) < 1e-12:
        raise ValueError("must point somewhere, but is no longer than 1e-6")
    return axis


class SpringSection(SourceSection):
    """A virtual fixture: the MRF is pulled to a line or a plane, rate = K_S (way to it)."""

    ERROR_GAIN: ClassVar[str | None] = "K_S"

    gain: tuple[AxisGain, AxisGain, AxisGain, AxisGain, AxisGain, AxisGain] = Field(
        (0.0,) * 6, description="K_S: error to rate, per axis of relative_to [1/s]"
    )
    shape: Literal["line", "plane"] = Field("line", description="what it is pulled to")
    relative_to: Literal["world", "base", "carrier"] = Field(
        "world", description="frame that line or plane are fixed to: World, or one that may move"
    )
    point: Vector3 = Field((0.0, 0.0, 0.0), description="a point of it, in relative_to [m]")
    direction: Vector3 = Field(
        (0.0, 0.0, 1.0), description="of the line, or the plane's normal, in relative_to [1]"
    )
    tool_axis: Vector3 | None = Field(
        None, description="axis of the MRF that is turned into the direction; none: no turning [1]"
    )
    deadband: float = Field(0.0, ge=0, le=1, description="way to it that is let be [m]")
    angular_deadband: float = Field(0.0, ge=0, le=3, description="the same of the angle [rad]")
    speed: float = Field(0.1, gt=0, le=5, description="largest rate that it asks for [m/s]")
    angular_speed: float = Field(0.3, gt=0, le=10, description="the same [rad/s]")

    @field_validator("direction", "tool_axis")
    @classmethod
    def _points_somewhere(
        cls, axis: tuple[float, float, float] | None
    ) -> tuple[float, float, float] | None:
        return None if axis is None else _somewhere(axis)

    def lacking(self, there: Set[str]) -> Iterator[str]:
        """Yield that the frame which the fixture is fixed to does not move."""
        if self.relative_to != "world" and self.relative_to not in there:
            yield (
                f"relative_to: value '{self.relative_to}': there is no "
                f"[frames.{self.relative_to}], so give the fixture in World"
            )


# --- Schema of the source that looks at a point ---------------------------------------------------


class PointAtSection(SourceSection):
    """The tool is turned so that an axis of it looks at a point: rate = K_A (angle to it).

    How the tool turns about that axis is left to others, and so is where it is.
    """

    ERROR_GAIN: ClassVar[str | None] = "K_A"

    gain: tuple[NoGain, NoGain, NoGain, AxisGain, AxisGain, AxisGain] = Field(
        (0.0,) * 6,
        description="K_A: angle to rate, about the axes of World; it asks for no translation [1/s]",
    )
    point: Vector3 = Field((0.0, 0.0, 0.0), description="where it looks, in relative_to [m]")
    relative_to: Literal["world", "base", "carrier"] = Field(
        "world", description="frame that the point is fixed to: World, or one that may move"
    )
    tool_axis: Vector3 = Field(
        (0.0, 0.0, 1.0), description="axis of the MRF that looks there, from its origin [1]"
    )
    nearest: float = Field(
        0.1,
        ge=0.01,
        le=2,
        description="nearer to the point it asks for less and less, at half of it for nothing [m]",
    )
    angular_speed: float = Field(
        0.5, gt=0, le=10, description="largest rate that it asks for [rad/s]"
    )

    @field_validator("tool_axis")
    @classmethod
    def _points_somewhere(cls, axis: tuple[float, float, float]) -> tuple[float, float, float]:
        return _somewhere(axis)

    def lacking(self, there: Set[str]) -> Iterator[str]:
        """Yield that the frame which the point is fixed to does not move."""
        if self.relative_to != "world" and self.relative_to not in there:
            yield (
                f"relative_to: value '{self.relative_to}': there is no "
                f"[frames.{self.relative_to}], so give the point in World"
            )


# --- Schema of the source that keeps a camera's view ----------------------------------------------


class VisionSection(SourceSection):
    """A camera's view: rate = K_V (desired view − seen view), per axis of the Lens."""

    NEEDS: ClassVar[Literal["camera"]] = "camera"
    ERROR_GAIN: ClassVar[str | None] = "K_V"

    enabled: bool = Field(False, description="switch at start")
    gain: tuple[AxisGain, AxisGain, AxisGain, AxisGain, AxisGain, AxisGain] = Field(
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


# --- The sources that there are: one field each ---------------------------------------------------


class SourcesSection(Section):
    """Sources, which ask the tool for rates. All on at once; the rates add."""

    joystick: JoystickSection = Field(
        default_factory=JoystickSection, description="the operator's stick"
    )
    position: PositionSection = Field(default_factory=PositionSection, description="target poses")
    vision: VisionSection = Field(default_factory=VisionSection, description="a camera's view")
    force: ForceSection = Field(default_factory=ForceSection, description="force control")
    following: FollowingSection = Field(
        default_factory=FollowingSection, description="a hand at the tool"
    )
    spring: SpringSection = Field(default_factory=SpringSection, description="a virtual fixture")
    point_at: PointAtSection = Field(
        default_factory=PointAtSection, description="an axis of the tool that looks at a point"
    )
    reflex: ReflexSection = Field(
        default_factory=ReflexSection, description="folding below what is ahead"
    )

    @property
    def each(self) -> dict[str, SourceSection]:
        """The sections by name, in the order in which rates are summed."""
        return {name: getattr(self, name) for name in SOURCES}


SOURCES = tuple(SourcesSection.model_fields)
"""Names of the sources, in the order in which rates are summed."""


def _known(name: str) -> str:
    if name not in SOURCES:
        raise ValueError(f"no such source: the sources are {', '.join(SOURCES)}")
    return name


SourceName = Annotated[str, AfterValidator(_known)]


# --- Schema of gains that change with something measured ------------------------------------------


class ScheduleSection(Section):
    """A source's gain as a function of something measured: a table of factors, interpolated."""

    source: SourceName = Field(description="name of the source whose gain it is")
    by: Literal["contact_force", "distance", "time"] = Field(
        description="what decides: contact force at the MRF [N], distance from the MRF to the "
        "target [m], or time since enable [s]"
    )
    at: tuple[NonNegative, ...] = Field(
        min_length=2, max_length=32, description="where the table's points are, rising [N, m or s]"
    )
    factor: tuple[Share, ...] = Field(
        min_length=2, max_length=32, description="the gain's factor at each, 0 to 1 [1]"
    )
    axes: tuple[Share, Share, Share, Share, Share, Share] = Field(
        (1.0,) * 6, description="how much each axis heeds the factor: 1 in full, 0 not at all [1]"
    )

    @model_validator(mode="after")
    def _is_a_table(self) -> "ScheduleSection":
        if len(self.at) != len(self.factor):
            raise ValueError(f"{len(self.at)} points in 'at', {len(self.factor)} in 'factor'")
        if any(b <= a for a, b in zip(self.at, self.at[1:], strict=False)):
            raise ValueError("'at' must rise from point to point")
        return self
