"""What a test shows a source: a tick's context, of which it says what matters to it."""

import numpy as np
from telerobot.server.control.compiled import evolve
from telerobot.server.control.inputs import Inputs, Intent, Settings
from telerobot.server.control.spatial import Kinematics, Pose
from telerobot.server.control.task.source import Context, Granted, Shaping

T = 0.01
A = np.array([2.0] * 3 + [6.0] * 3)
J = np.array([40.0] * 3 + [120.0] * 3)
SHAPING = Shaping(A, J, (0.5, 1.5), T)
_HERE = Pose.identity()
_SETTINGS = Settings({}, _HERE, _HERE, np.zeros(6))
_INPUTS = Inputs(0.0, Intent.MOVE, np.zeros(7), _SETTINGS)
_K = Kinematics(_HERE, _HERE, np.zeros((6, 7)))
_CONTEXT = Context(
    inputs=_INPUTS,
    moving=True,
    guided=True,
    k=_K,
    twist=np.zeros(6),
    lever=np.zeros(3),
    ground=None,
    carried=None,
    wrench=None,
    hand=None,
    wrench_at=lambda _T_wrist_mrf: (None, None),
    load=None,
    precedence=0.0,
    off_path=None,
)


def shown(**said):
    """Return a context of an arm that moves; fields of it and of its inputs by their names."""

    def taken(record):
        return {f: said.pop(f) for f in record.__dataclass_fields__ if f in said}

    settings = evolve(_SETTINGS, **taken(_SETTINGS))
    k = _K._replace(**{f: said.pop(f) for f in _K._fields if f in said})
    inputs = evolve(_INPUTS, settings=settings, **taken(_INPUTS))
    moving = inputs.intent is Intent.MOVE
    guided = moving and inputs.jog is None
    return _CONTEXT._replace(inputs=inputs, moving=moving, guided=guided, k=k, **said)


def granted(share=1.0, pace=None, slid=False, twist=None, T_world_mrf=_HERE):
    """Return what was let through of a tick's motion; a path goes on as the tool does."""
    twist = np.zeros(6) if twist is None else twist
    return Granted(share, share if pace is None else pace, slid, twist, T_world_mrf)
