"""Joint tasks on and off, at rest: arms that each have a task alone, and that hold one payload."""

from collections.abc import Sequence

from ..arm.arm import Arm
from ..evolve import evolve
from ..spatial import Array
from ..state import Memory
from .joint_task import FIT_M, JointTask

AT_REST = 1e-9
"""Joint rates [rad/s] and accelerations [rad/s²] below this are rounding, not motion."""


class HoldRefused(Exception):
    """Arms cannot hold a payload together, or let go of it, now: it says why."""


def held_together(
    task: JointTask, memories: Sequence[Memory], q: Sequence[Array], always: bool = False
) -> tuple[Memory, ...]:
    """Return the memories of all arms, with those of a task that hold its payload from now on.

    `q` are the joints of each arm (n,) as they were measured: grasps are what they make of them.
    Raises `HoldRefused` for arms that move, that hold another payload, and for grasps that do not
    fit, but for the last if it is `always`.
    """
    for i, arm in zip(task.members, task.arms, strict=True):
        held = memories[i].held
        if held is not None and held.task != task.name:
            raise HoldRefused(f"{_name(arm)} holds '{held.task}'")
    _require_rest(task, memories)
    misfit = task.grips.misfit([q[i] for i in task.members])
    if misfit > FIT_M and not always:
        raise HoldRefused(
            f"the grasps are {1e3 * misfit:.0f} mm from fitting each other: at most "
            f"{1e3 * FIT_M:.0f} mm"
        )
    measured = [
        arm.mechanism.pose_wrist(q[i]) for i, arm in zip(task.members, task.arms, strict=True)
    ]
    found = list(memories)
    grasps, _ = task.grips.taken(measured, [memories[i] for i in task.members])
    for i, arm, held in zip(task.members, task.arms, grasps, strict=True):
        found[i] = evolve(_idle(arm, memories[i]), held=held)
    return tuple(found)


def let_go(task: JointTask, memories: Sequence[Memory]) -> tuple[Memory, ...]:
    """Return the memories of all arms, with those of a task that each have a task alone from now.

    Raises `HoldRefused` for arms that move.
    """
    _require_rest(task, memories)
    found = list(memories)
    for i, arm in zip(task.members, task.arms, strict=True):
        found[i] = evolve(_idle(arm, memories[i]), held=None)
    return tuple(found)


def _idle(arm: Arm, memory: Memory) -> Memory:
    """Return the memory of an arm whose task was asked for nothing yet; its gains stay."""
    idle = arm.stages.task.idle
    retreat = None if arm.stages.retreat is None else arm.stages.retreat.start
    return evolve(memory, task=idle._replace(gains=memory.task.gains), retreat=retreat)


def _require_rest(task: JointTask, memories: Sequence[Memory]) -> None:
    for i, arm in zip(task.members, task.arms, strict=True):
        if not memories[i].motion.stands(AT_REST):
            raise HoldRefused(f"{_name(arm)} moves")


def _name(arm: Arm) -> str:
    """Return how an arm is called: by the mechanism that its joints bear the name of."""
    return arm.p.joints.names[0].partition(".")[0]
