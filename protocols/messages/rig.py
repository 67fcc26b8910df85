"""The virtual hardware's own topics: for judges and fault injection, never for the daemon.

The envelope, units and conventions are those of `messages.py`.
"""

from typing import Literal

from pydantic import Field

from .messages import Count, JointVector, Message, Vector3, Vector6


class RigFault(Message):
    """A fault for the rig to inject, or to take back with `on = false`.

    `target` is the name of a joint or of another device, a bus for `unplug`, a tag for `cover` and
    `move`, an obstacle for `place`, or "base" or "carrier" for `silence`; `value` depends on the
    kind: probability for `drop` and `corrupt`, seconds for `delay`. `vector` is in World: the force
    [N] at the joint's link for `push` or at the MRF for `hand` (whose `value` is how long it takes
    to come and go [s]), the new place [m] for `move` and `place`.
    """

    kind: Literal[
        "silence", "fault", "stick", "block", "drop", "delay", "corrupt", "freeze", "push", "emcy",
        "cover", "move", "place", "hand", "unplug",
    ]  # fmt: skip
    target: str = Field(max_length=64)
    on: bool = True
    value: float | None = None
    vector: Vector3 | None = None


class RigTruth(Message):
    """The physics' truth, for whoever judges.

    True MRF pose in World `[x, y, z, roll, pitch, yaw]`, joints and rates, contact force of the
    tool [N] in World as exerted on the environment, least distance between arm and fixed things,
    poses of the tags that stand in World, names of those that are covered, poses of `base` and
    `carrier` where they may move, and for each camera that stands in World how far each link is
    from its `sight` line [m].
    """

    time_s: float
    sync_count: Count
    q: JointVector
    dq: JointVector
    pose_mrf: Vector6
    contact_force: Vector3
    clearance_m: float | None
    drives: tuple[str, ...]
    tags: dict[str, Vector6] = Field(default_factory=dict)
    covered: tuple[str, ...] = ()
    frames: dict[str, Vector6] = Field(default_factory=dict)
    sight: dict[str, dict[str, float]] = Field(default_factory=dict)
