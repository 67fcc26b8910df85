"""What a test shows a source: a tick's context, of which it says what matters to it."""

import numpy as np
from telerobot.server.control.spatial import Pose
from telerobot.server.control.task.source import Asked, Context, Granted, Shaping

T = 0.01
A = np.array([2.0] * 3 + [6.0] * 3)
J = np.array([40.0] * 3 + [120.0] * 3)
SHAPING = Shaping(A, J, (0.5, 1.5), T)
_HERE = Pose.identity()
_ASKED = Asked(
    T_wrist_mrf=_HERE,
    T_world_crf=_HERE,
    redefined=0,
    ground="world",
    speed_factor=1.0,
    stick=None,
    goal=None,
    T_wrist_goal=_HERE,
    paused=False,
    view=None,
    wrench_desired=np.zeros(6),
    R_world_wrench=None,
)
_CONTEXT = Context(
    asked=_ASKED,
    moving=True,
    guided=True,
    holding=False,
    T_world_wrist=_HERE,
    T_world_mrf=_HERE,
    twist=np.zeros(6),
    lever=np.zeros(3),
    moved=None,
    ground=None,
    carried=None,
    wrench=None,
    hand=None,
    wrench_at=lambda _T_wrist_mrf: None,
    load=None,
    precedence=0.0,
    off_path=None,
)


def shown(**said):
    """Return a context of an arm that moves; fields of `Asked` and of `Context` by their names."""
    asked = {name: said.pop(name) for name in Asked._fields if name in said}
    return _CONTEXT._replace(asked=_ASKED._replace(**asked), **said)


def granted(share=1.0, pace=None, slid=False, twist=None, T_world_mrf=_HERE):
    """Return what was let through of a tick's motion; a path goes on as the tool does."""
    twist = np.zeros(6) if twist is None else twist
    return Granted(share, share if pace is None else pace, slid, twist, T_world_mrf)
