"""Schema of a cell file: every field with its unit, bound, default and meaning.

One TOML file describes one cell. Unknown keys are errors, numbers are finite, SI throughout
(metres, radians, seconds, newtons). `load.py` reads a file into these models and adds the robot
description; `check.py` in the tools judges what a schema cannot see.
"""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from .bus import BusSection, EnablingSwitchSection
from .mechanism import MechanismSection, TorqueSection, TouchSection
from .network import ReflectionSection, ZenohSection
from .null_space import PotentialFieldSection, PrioritySection, RedundancySection
from .rig import RigSection
from .section import Name, PoseSection, Section
from .sources import ScheduleSection, SourcesSection
from .surroundings import (
    AvoidanceSection,
    CameraSection,
    ContourReflexSection,
    FramesSection,
    ObstacleSection,
    ScannerSection,
)


def _switched_off(value: object) -> object:
    """Return nothing for a table that is `false`: that of another cell does not come along."""
    return None if value is False else value


class TimingSection(Section):
    """The clockwork: T < tolerated overruns * T < setpoint < heartbeat < lease timeout."""

    period_s: float = Field(0.010, ge=0.001, le=0.1, description="control and SYNC period T [s]")
    tolerated_overruns: int = Field(
        4, ge=1, le=50, description="late ticks in a row before the verified stop [1]"
    )
    setpoint_timeout_s: float = Field(
        0.080, gt=0, le=1, description="a drive without a new setpoint stops by itself after [s]"
    )
    heartbeat_period_s: float = Field(
        0.050, gt=0, le=1, description="heartbeats are produced every [s]"
    )
    heartbeat_timeout_s: float = Field(
        0.200, gt=0, le=5, description="a silent heartbeat is a dead peer after [s]"
    )
    lease_timeout_s: float = Field(
        0.500, gt=0, le=10, description="an operator's lease that is not renewed ends after [s]"
    )
    stream_timeout_s: float = Field(
        0.150, gt=0, le=5, description="a stream (stick, jog) fades when its news is older than [s]"
    )
    max_command_age_s: float = Field(
        0.500, gt=0, le=10, description="oldest telemetry a command may be based on [s]"
    )


class LimitsSection(Section):
    """Bounds of the tool's motion; joint bounds stand with the drives."""

    speed: float = Field(0.5, gt=0, le=10, description="MRF speed [m/s]")
    jog_speed: float = Field(
        10.0, gt=0, le=10, description="MRF speed of a jog, where that is less [m/s]"
    )
    posture_speed: float = Field(
        10.0, gt=0, le=10, description="MRF speed towards a posture, where that is less [m/s]"
    )
    angular_speed: float = Field(1.5, gt=0, le=20, description="MRF angular speed [rad/s]")
    acceleration: float = Field(2.0, gt=0, le=100, description="shaping of commands [m/s²]")
    angular_acceleration: float = Field(6.0, gt=0, le=300, description="the same [rad/s²]")
    jerk: float = Field(40.0, gt=0, le=10_000, description="shaping of commands [m/s³]")
    angular_jerk: float = Field(120.0, gt=0, le=30_000, description="the same [rad/s³]")
    speed_factor: float = Field(
        1.0,
        ge=0.01,
        le=1.0,
        description="reduced speed: one factor on all limits but those of stops, at start [1]",
    )


class ResolveSection(Section):
    """Damped resolution of tool rates into joint rates near singularities."""

    characteristic_length: float = Field(
        0.3, gt=0, le=5, description="weighs radians against metres [m]"
    )
    singular_region: float = Field(
        0.05, gt=0, le=2, description="σ0: damping begins below this singular value [m]"
    )
    damping: float = Field(0.02, gt=0, le=2, description="λm: damping at σ = 0 [m]")
    floor: float = Field(
        0.01, gt=0, le=1, description="singular value below which motion into it is held off [m]"
    )
    free_axes: tuple[Literal["x", "y", "z", "rx", "ry", "rz"], ...] = Field(
        (), max_length=5, description="axes of the MRF that the task leaves to the null space"
    )

    @field_validator("free_axes")
    @classmethod
    def _once(cls, axes: tuple[str, ...]) -> tuple[str, ...]:
        twice = next((name for name in axes if axes.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"'{twice}' is there twice")
        return axes

    @model_validator(mode="after")
    def _is_bounded(self) -> "ResolveSection":
        # Joint rates are at most |ẋ| / (2 λm √(1 − λm²/σ0²)), the greatest damped gain there is.
        for name in ("damping", "floor"):
            value = getattr(self, name)
            if value >= self.singular_region:
                raise ValueError(
                    f"{name} = {value:g} must be below singular_region = {self.singular_region:g}"
                )
        return self


class CellConfig(Section):
    """A whole cell file."""

    name: Name = Field(description="name of the cell: the second part of every Zenoh key")
    description: str = Field("", max_length=200, description="one line for people")
    default_script: str = Field(
        description="path, from this file's folder, or the name of a script that is shipped"
    )
    timing: TimingSection = Field(default_factory=TimingSection, description="periods and timeouts")
    bus: BusSection = Field(
        default_factory=BusSection, description="the CAN bus of a cell with one"
    )
    buses: tuple[BusSection, ...] = Field(
        (), max_length=8, description="the CAN buses, instead of [bus]"
    )
    zenoh: ZenohSection = Field(default_factory=ZenohSection, description="the operators' network")
    mechanism: MechanismSection = Field(description="the arm")
    enabling_switch: EnablingSwitchSection | None = Field(
        None, description="switch that is held while the arm may move; absent: there is none"
    )
    cameras: tuple[CameraSection, ...] = Field((), description="cameras, each looking for one tag")
    T_world_crf: PoseSection = Field(
        default_factory=PoseSection, description="control reference frame in World, at start"
    )
    frames: FramesSection = Field(default_factory=FramesSection, description="frames that may move")
    sources: SourcesSection = Field(
        default_factory=SourcesSection, description="who may ask for a tool rate"
    )
    schedules: tuple[ScheduleSection, ...] = Field(
        (), max_length=16, description="gains that change with force, distance or time"
    )
    reflection: ReflectionSection | None = Field(
        None, description="force reflection to the operator; absent where there is none"
    )
    limits: LimitsSection = Field(
        default_factory=LimitsSection, description="bounds of the tool's motion"
    )
    resolve: ResolveSection = Field(default_factory=ResolveSection, description="singularities")
    redundancy: RedundancySection = Field(
        default_factory=RedundancySection, description="the null space"
    )
    torque: TorqueSection = Field(
        default_factory=TorqueSection, description="the law of drives in CST"
    )
    obstacles: tuple[ObstacleSection, ...] = Field(
        (), max_length=64, description="what the arm keeps away from"
    )
    avoidance: AvoidanceSection = Field(
        default_factory=AvoidanceSection, description="clearances that are kept"
    )
    potential: PotentialFieldSection = Field(
        default_factory=PotentialFieldSection, description="what repels the links, softly"
    )
    touch: Annotated[TouchSection | None, BeforeValidator(_switched_off)] = Field(
        None, description="collision detection; absent, or false: off"
    )
    priority: PrioritySection | None = Field(
        None, description="virtual spheres that obstacles push, before a hand is followed"
    )
    scanner: ScannerSection | None = Field(
        None, description="laser scanner that looks ahead of the arm; absent: there is none"
    )
    contour: ContourReflexSection | None = Field(
        None, description="obstacles ahead, and how the arm folds to pass them; needs a scanner"
    )
    rig: RigSection | None = Field(None, description="virtual hardware; absent where it is real")

    @property
    def keeps_clear(self) -> bool:
        """True for a cell that says anything of obstacles or their avoidance."""
        return bool({"avoidance", "obstacles"} & self.model_fields_set)

    @property
    def fieldbuses(self) -> tuple[BusSection, ...]:
        """The cell's CAN buses, one or several."""
        return self.buses or (self.bus,)
