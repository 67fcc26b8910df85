"""What happens meanwhile in a script: to the hardware, its surroundings, and the network."""

from typing import Any, Literal, get_args

from pydantic import Field, model_validator

from ...protocols.messages import messages as m
from .steps import Part


class TargetStep(Part):
    """A camera's target that moves straight; the daemon hears where its sight line ends."""

    tag: str = Field(max_length=32)
    sight_line: str | None = Field(None, max_length=32)
    start: m.Place
    to: m.Place
    speed: float = Field(gt=0, le=10)


class MotionStep(Part):
    """How the platform under the arm or the Carrier moves from now on: see `RigMotion`."""

    twist: m.Twist = (0.0,) * 6
    sway: m.Twist = (0.0,) * 6
    period_s: float = Field(4.0, ge=0.2, le=600)


FaultKind = Literal[
    "silence", "fault", "stick", "block", "drop", "delay", "corrupt", "freeze", "push", "emcy",
    "cover", "move", "place", "hand", "unplug",
]  # fmt: skip


class FaultStep(Part):
    """A fault of the virtual hardware, as `{ kind = "target" }`; `on = false` takes it back."""

    kind: FaultKind
    target: str = Field(max_length=64)
    on: bool = True
    value: float | None = None
    vector: m.Vector3 | None = None

    @model_validator(mode="before")
    @classmethod
    def _kind_is_a_key(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "kind" in data:
            return data
        kinds = [k for k in data if k in get_args(FaultKind)]
        if len(kinds) != 1:
            raise ValueError(f"one fault of {', '.join(get_args(FaultKind))}")
        rest = {k: v for k, v in data.items() if k != kinds[0]}
        return {"kind": kinds[0], "target": data[kinds[0]], **rest}


class ObstacleStep(Part):
    """An obstacle that is put somewhere, moves on at a velocity, or goes.

    What is physical and what the daemon is told are two things: without `physical` it is only
    told, without `tell` it is only there. Of one that moves, news is told 20 times a second, with
    its velocity where `max_acceleration` is given; `silent` ends the news, the obstacle goes on.
    With `remove` the daemon is told that it is gone, and it stands still where it is, or at `xyz`.
    """

    name: str = Field(max_length=32)
    shape: Literal["point", "sphere", "capsule", "box", "sight_line"] | None = None
    xyz: m.Place | None = None
    to: m.Place | None = None
    rpy: m.Attitude | None = None
    half_size: m.Vector3 | None = None
    radius: float | None = None
    velocity: m.Vector3 | None = None
    max_speed: float | None = None
    max_acceleration: float | None = None
    timeout_s: float | None = None
    stale: Literal["keep", "grow", "stop"] | None = None
    clearance: float | None = None
    hard: bool | None = None
    remove: bool = False
    physical: bool = True
    tell: bool = True
    silent: bool = False


class LinkStep(Part):
    """What happens to an operator's connection."""

    cut: bool = False
    delay_s: float = Field(0.0, ge=0, le=60)
    """One way, the same in both directions."""
    jitter: float = Field(0.0, ge=0, le=1)
    loss: float = Field(0.0, ge=0, lt=1)


class Network(Part):
    """The operators' network from the start: round trip, its variation, its losses."""

    rtt_s: float = Field(0.0, ge=0, le=10)
    jitter: float = Field(0.0, ge=0, le=1)
    loss: float = Field(0.0, ge=0, lt=1)
    seed: int = Field(1, ge=0)
