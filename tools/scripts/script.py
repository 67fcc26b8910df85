"""Scripts: what operators do over time, and which faults happen meanwhile, in TOML.

    duration_s = 6.0
    [[step]]
    at_s = 0.5
    joystick = { twist = [0.05, 0, 0, 0, 0, 0], expressed_in = "base" }

Times count from the moment the arm is enabled. A stick or jog is streamed at 100 Hz until the next
step of its kind. The same script drives a simulation and a running daemon.
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from ...config.load import ConfigError, read_toml, script_path
from ...protocols.messages import messages as m
from .incidents import FaultStep, LinkStep, MotionStep, Network, ObstacleStep, TargetStep
from .steps import (
    ClutchStep,
    DeviceStep,
    FrameStep,
    Gain,
    Jog,
    MasterStep,
    Objective,
    Part,
    PathStep,
    PayloadStep,
    Raw,
    ReflectionStep,
    Stick,
    Switch,
    Target,
    WrenchStep,
)

NonNegative = Annotated[float, Field(ge=0)]


class Step(Part):
    """One moment of a script; everything in it happens at `at_s`, in this order."""

    at_s: NonNegative
    operator: m.OperatorName = "operator"
    lease: Literal["acquire", "release"] | None = None
    link: LinkStep | None = None
    mode: Literal["enable", "hold", "resume", "disable", "reset"] | None = None
    protective_stop: bool | None = None
    speed: float | None = Field(None, ge=0.01, le=1)
    store_view: str | None = None
    """Camera whose present view is to be kept."""
    gain: Gain | None = None
    switch: Switch | None = None
    frame: FrameStep | None = None
    payload: PayloadStep | None = None
    gripper: Literal["close", "open"] | None = None
    tare: bool = False
    acknowledge_load: bool = False
    redundancy: Objective | None = None
    clutch: ClutchStep | None = None
    path_control: Literal["pause", "resume", "abort"] | None = None
    cancel: bool = False
    joystick: Stick | None = None
    jog: Jog | None = None
    position: Target | None = None
    posture: Annotated[str, Field(max_length=32)] | m.JointVector | None = None
    path: PathStep | None = None
    master: MasterStep | None = None
    device: DeviceStep | None = None
    reflection: ReflectionStep | None = None
    force: m.Wrench | WrenchStep | None = None
    target: TargetStep | None = None
    raw: Raw | None = None
    obstacle: ObstacleStep | None = None
    avoidance: bool | None = None
    """Whether clearances are kept."""
    fault: FaultStep | None = None
    platform: MotionStep | None = None
    """How what the arm stands on moves from now on."""
    carrier: MotionStep | None = None
    """How what the CRF may ride on moves from now on."""


class Script(Part):
    """What happens over a run."""

    description: str = ""
    duration_s: float = Field(gt=0, le=3600)
    auto_enable: bool = True
    """The operator takes the lease and enables the arm before time starts."""
    network: Network = Network()
    step: tuple[Step, ...] = ()

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps in order of time."""
        return tuple(sorted(self.step, key=lambda s: s.at_s))


def load_script(name_or_path: str | Path, base: Path = Path()) -> Script:
    """Load a script: a path, or the name of one that is shipped. Raises `ConfigError`."""
    path = script_path(name_or_path, base)
    try:
        return Script.model_validate(read_toml(path))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        value = str(first["input"])[:60]
        raise ConfigError(f"{path}: {key}: value {value}: {first['msg']}") from None
