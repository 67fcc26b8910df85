"""The virtual hardware's own topics, for judges and fault injection; never for the daemon."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from .messages import Count, JointVector, Message, Vector3, Vector6

# --- The virtual hardware's own topics: for judges and fault injection, never for the daemon ------
#
# The envelope, units and conventions are those of `messages.py`.


class RigFault(Message):
    """A fault for the rig to inject, or to take back with `on = false`.

    `target` is the name of a joint or of another device (`left.s1` in a cell of several
    mechanisms), `scanner`, a bus for `unplug`, a tag for `cover` and `move`, an obstacle for
    `place`, or "base" or "carrier" for `silence`; `value` depends on the kind: probability for
    `drop` and `corrupt`, seconds for `delay`, friction for `slip` of a wheel, rad/s for `bias` of
    an inertial unit. `vector` is in World: the force [N] at the joint's link for `push` or at the
    MRF for `hand` (whose `value` is how long it takes to come and go [s]), the new place [m] for
    `move` and `place`. In the axes of a force/torque sensor it is the force [N] that its zero is
    off by, for `bias`; `value` is how long that takes to come [s].
    """

    kind: Literal[
        "silence", "fault", "stick", "block", "drop", "delay", "corrupt", "freeze", "push", "emcy",
        "cover", "move", "place", "hand", "unplug", "crop", "slip", "restart", "bias",
    ]  # fmt: skip
    target: str = Field(max_length=80)
    on: bool = True
    value: float | None = None
    vector: Vector3 | None = None


class ArmTruth(Message):
    """The truth about one arm.

    True MRF pose in World `[x, y, z, roll, pitch, yaw]`, and net contact force of the arm and its
    tool [N] in World, as exerted on the environment. `contact_sum` adds up magnitudes over the
    pairs of solids that touch, where opposite forces do not cancel [N]; `contact_peak` is the
    greatest of these in the physics steps of the last period.
    """

    pose_mrf: Vector6
    contact_force: Vector3
    contact_sum: float = 0.0
    contact_peak: float = 0.0


class BeamTruth(Message):
    """The truth about a payload that several arms hold.

    Its pose in World `[x, y, z, roll, pitch, yaw]`; the wrench of each arm on it at its grasp
    [N, N·m], in the payload's axes; the greatest force at a grasp that moves nothing
    (`internal_force`) [N], how far the grasps are from fitting each other (`stretch`) [m], how deep
    each peg is in the nearest hole (`peg_depth`) [m], negative before it, what payload and pegs
    `push` on what stands around, in World [N], and the greatest sum of the magnitudes of that in
    the physics steps of the last period (`push_peak`) [N].
    """

    pose: Vector6
    grasps: tuple[Vector6, ...]
    internal_force: float
    stretch: float
    peg_depth: tuple[float, ...] = ()
    push: Vector3
    push_peak: float = 0.0


class RigTruth(Message):
    """The physics' truth, for whoever judges.

    Joints, rates and drives of all arms, in the order of the cell; `arms` by the names of the
    mechanisms, `pose_mrf` and `contact_force` of the first one; least distance between arms and
    fixed things, and of arms from each other (at most 1) [m]; poses of the tags that stand in
    World, names of those that are covered, poses of `base` and `carrier` where they may move, and
    for each camera that stands in World how far each link is from its `sight` line [m].
    `own_contact_peak` is the greatest sum, in the physics steps of the last period, of what arms
    and payload press on themselves and each other [N].
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
    arms: dict[str, ArmTruth] = Field(default_factory=dict)
    between_arms_m: float | None = None
    own_contact_peak: float = 0.0
    beam: BeamTruth | None = None
    """The payload that several arms hold; None where there is none."""


# --- Values and vectors of faults: within their bounds, or refused in one line --------------------

FARTHEST = 100.0
"""Nothing is put farther from World's origin along an axis [m]."""
MOST_FORCE = 5000.0
"""The physics is not pushed harder along an axis: it would break before the arm does [N]."""
MOST_FRICTION = 1e4
"""Nor is a joint braked harder [N·m]."""


def vector_of(fault: RigFault, most: float, unit: str) -> NDArray[np.float64]:
    """Return a fault's vector (3,).

    Raises `ValueError`, in one line, for none, and for one beyond `most` along an axis.
    """
    if fault.vector is None:
        raise ValueError(f"fault {fault.kind}: give its vector [{unit}]")
    for x in fault.vector:
        if not abs(x) <= most:
            raise ValueError(
                f"fault {fault.kind}: value {x:g} {unit}: must be at most {most:g} along an axis"
            )
    return np.array(fault.vector)


def value_of(
    fault: RigFault, low: float, high: float, unit: str, default: float | None = None
) -> float:
    """Return a fault's value, or the default. Raises `ValueError` for one out of bounds."""
    value = default if fault.value is None else fault.value
    if value is None or not low <= value <= high:
        raise ValueError(f"fault {fault.kind}: value {value:g} {unit}: must be {low:g} to {high:g}")
    return value
