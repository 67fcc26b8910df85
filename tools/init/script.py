"""The default script of a cell that `init` makes: it moves, stops, and touches a wall."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from .shape.shapes import Array

WITHIN = 0.2
"""The push on the wall is expected within this part of what is asked for [1]."""


class ScriptFigures(NamedTuple):
    """Figures of the script's steps; in World."""

    ready_s: float
    """From `start` to `ready` [s]."""
    aside: Array
    """Twist (6,) of the stick [m/s]."""
    target: tuple[Array, Array]
    """Pose of the MRF: place [m], roll, pitch, yaw [rad]."""
    target_s: float
    forward: Array
    """Direction of the wall (3,)."""
    approach: tuple[float, float]
    """Speed of the stick towards it [m/s], and how long [s]."""
    press: float
    """Speed of the stick that pushes [m/s]."""
    force: float
    """Force that follows from it [N]."""
    press_s: float
    """Time of the push [s]."""


def text_of(plans: Mapping[str, ScriptFigures], name: str) -> str:
    """Return the script's file: of an only arm, which has no name here, or of several.

    Each moves while the others stand at `ready`; the first one ends on the wall.
    """
    at = 0.2
    steps = [_step(at, f'"cmd/posture" = {{ {_of(arm)}posture = "ready" }}') for arm in plans]
    at += max(plan.ready_s for plan in plans.values())
    first, *others = plans
    for arm in (*others, first):
        more, at = _moves(plans[arm], arm, at, stopped=arm == first)
        steps += more
    plan = plans[first]
    speed, lasts = plan.approach
    toward = np.concatenate([plan.forward, np.zeros(3)])
    steps += [
        "# into the wall: speed / force gain is the force that it settles at",
        _stick(first, at, speed * toward),
    ]
    at += lasts
    steps += [_stick(first, at, plan.press * toward)]
    at += plan.press_s
    words = f"{name}: a stick, a stop, a pose, and a push of {plan.force:.3g} N on the wall"
    least, most = plan.force * (1.0 - WITHIN), plan.force * (1.0 + WITHIN)
    head = [
        f'description = "{words}"',
        f"duration_s = {at:.1f}",
        '\n[expect]\nmode = "enabled"',
        f"contact_force_n = {{ least = {least:.3g}, most = {most:.3g} }}\n",
    ]
    return "\n".join([*head, *steps])


def _moves(plan: ScriptFigures, arm: str, at: float, *, stopped: bool) -> tuple[list[str], float]:
    """Return an arm's steps by stick and to a pose, and when they have ended."""
    steps = [f"# aside by the stick{'; the verified stop while it moves; on' * stopped}"]
    steps += [_stick(arm, at, plan.aside, 1.0)]
    if stopped:
        steps += [_step(at + 1.0, '"operator/mode" = { action = "hold" }')]
        steps += [_step(at + 2.0, '"operator/mode" = { action = "resume" }')]
    at += 2.5
    xyz, rpy = plan.target
    pose = f'xyz = {_list(xyz)}, rpy = {_list(rpy)}, relative_to = "world"'
    task = _of(arm, "task")
    steps += ["# to a pose, and back", _step(at, f'"cmd/position" = {{ {task}{pose} }}')]
    at += plan.target_s
    cancelled = f" {task.removesuffix(', ')} " if task else ""
    steps += [_step(at, f'"cmd/cancel" = {{{cancelled}}}')]
    steps += [_step(at, f'"cmd/posture" = {{ {_of(arm)}posture = "ready" }}')]
    return steps, at + max(plan.ready_s, plan.target_s)


def _stick(arm: str, at: float, twist: Array, for_s: float | None = None) -> str:
    told = f'{_of(arm, "task")}twist = {_six(twist)}, expressed_in = "world"'
    return _step(at, f'"cmd/joystick" = {{ {told} }}', for_s)


def _of(arm: str, key: str = "mechanism") -> str:
    """Return the field that names one of several arms."""
    return f'{key} = "{arm}", ' if arm else ""


def _step(at: float, body: str, for_s: float | None = None) -> str:
    lasts = "" if for_s is None else f"for_s = {for_s}\n"
    return f"[[step]]\nat_s = {at:.2f}\n{lasts}{body}\n"


def _six(twist: Array) -> str:
    return _list(twist, 5)


def _list(values: Array, digits: int = 5) -> str:
    return "[" + ", ".join(f"{float(v) + 0.0:.{digits}f}" for v in values) + "]"
