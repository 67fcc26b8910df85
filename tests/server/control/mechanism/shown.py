"""What a test shows an objective: one tick's view, of which it says what matters to it."""

import numpy as np
from telerobot.config.schema.null_space import RedundancySection
from telerobot.server.control.joints import Joints
from telerobot.server.control.mechanism.model import Dynamics
from telerobot.server.control.mechanism.objectives import View


def shown(q, **said):
    """Return the view of an arm with joint angles q (n,); fields of `View` by their names."""
    n = len(q)
    idle = View(q, np.zeros((6, n)), np.zeros(n), np.zeros((0, n)), q, {})
    return idle._replace(**said)


def built(kind, joints, mechanism, section=None):
    """Return an objective of an arm whose sensor is at its Wrist."""
    dynamics = Dynamics(mechanism, np.zeros(joints.n))
    return kind(joints, dynamics, section or RedundancySection())


def joints(lower, upper):
    """Return joints with limits (n,), and bounds that do not matter."""
    names, some = tuple(f"j{i}" for i in range(len(lower))), np.ones(len(lower))
    return Joints(names, lower, upper, some, some, some, some, some, some)
