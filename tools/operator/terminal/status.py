"""Lines of an operator's status: the arm, its motion, its bounds, the link. Pure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ....protocols.messages.telemetry import State, TaskState
from ....server.control.spatial import rotation_rpy
from ..words.limits import limit_words

ECHO_SHOWN_S = 1.0
"""A round trip older than this is not shown [s]."""

SHOWN = 1e-4
"""Smallest share of a twist that is shown [m/s, rad/s]."""

NAMES = {"joystick": "stick"}
"""Sources that people call otherwise, here as on the page."""


@dataclass(frozen=True)
class LinkStatus:
    """Link and lease, as an operator knows them."""

    mine: bool
    round_trip_s: float | None
    echo_age_s: float
    insecure: bool


def tool_words(pose: Sequence[float]) -> str:
    """Return a pose `[x, y, z, roll, pitch, yaw]` as its place and the tool's z and x axes.

    Axes change smoothly at every attitude; roll and yaw spin where the pitch is 90°.
    """
    x, y, z, *rpy = pose
    R = rotation_rpy(*rpy)
    axes = "  ".join(
        f"{name} {a:+.2f} {b:+.2f} {c:+.2f}" for name, (a, b, c) in (("z", R[:, 2]), ("x", R[:, 0]))
    )
    return f"xyz {x:+.3f} {y:+.3f} {z:+.3f} m  {axes}"


def joint_words(names: Sequence[str], q: Sequence[float]) -> str:
    """Return joint angles (n,) [rad] in degrees."""
    return " ".join(f"{name} {math.degrees(a):+.1f}°" for name, a in zip(names, q, strict=False))


def share_words(sources: Mapping[str, Sequence[float]]) -> str:
    """Return which sources move the tool, and how fast each would."""
    said = []
    for source, twist in sources.items():
        v, w = math.hypot(*twist[:3]), math.hypot(*twist[3:])
        parts = [f"{1e3 * v:.0f} mm/s"] * (v > SHOWN) + [f"{math.degrees(w):.1f} °/s"] * (w > SHOWN)
        if parts:
            said.append(f"{NAMES.get(source, source.replace('_', ' '))} {' '.join(parts)}")
    return " + ".join(said)


def arm_lines(
    state: State, led: TaskState, task: Sequence[str], jogged: Sequence[str], first: int
) -> list[str]:
    """Return the lines of an arm; `jogged` names its joints while they are jogged, else nothing.

    `first` is the place of its first joint among the cell's.
    """
    where = joint_words(jogged, state.q[first:]) if jogged else tool_words(led.pose_mrf)
    head = [state.mode.upper(), *task, where]
    if state.protective_stop:
        head.append("PROTECTIVE STOP")
    lines = [" | ".join(head)]
    if led.wrench_mrf is not None:
        fx, fy, fz, mx, my, mz = led.wrench_mrf
        lines.append(f"f {fx:+.1f} {fy:+.1f} {fz:+.1f} N  m {mx:+.2f} {my:+.2f} {mz:+.2f} N·m")
    moving = share_words(led.sources)
    if moving:
        lines.append(moving)
    lines += [limit_words(name) for name in led.limits]
    return lines


def link_words(state: State, link: LinkStatus) -> list[str]:
    """Return lease, round trip and speed, each as a few words."""
    holder = state.lease_holder
    words = [f"lease {holder or 'free'}{' (you)' if holder and link.mine else ''}"]
    if link.round_trip_s is not None:
        fresh = link.echo_age_s < ECHO_SHOWN_S
        words.append(f"round trip {1e3 * link.round_trip_s:3.0f} ms" if fresh else "no echo")
    words.append(f"overruns {state.overruns}")
    if link.insecure:
        words.append("INSECURE: anybody may command")
    if state.speed_factor < 1.0:
        words.append(f"speed limit {state.speed_factor:.0%}")
    return words
