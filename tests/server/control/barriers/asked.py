"""An arm in a tick, as the barriers see it."""

import numpy as np
from telerobot.server.control.barriers.clearance import BarrierInputs, Situation, Surroundings
from telerobot.server.control.bodies.rates import ArmMeasurement, DesiredRates, JointRates
from telerobot.server.control.hold import COMMANDED
from telerobot.server.control.inputs import Inputs, Intent, Settings
from telerobot.server.control.mechanism.redundancy import SelfMotion
from telerobot.server.control.spatial import NO_TWIST, Pose


def situation(k, dq, motion, scene):
    """Return that of an arm that follows at once, and is told to go at dq (n,)."""
    none = np.zeros(len(dq))
    found = JointRates(dq, SelfMotion(none, {}))
    desired = DesiredRates(dq, {}, NO_TWIST, 1.0, (), found, stance=COMMANDED)
    seen = ArmMeasurement(k, k.T_world_wrist, none)
    settings = Settings({}, Pose.identity(), Pose.identity(), np.zeros(6))
    inputs = Inputs(0.0, Intent.MOVE, motion.q, settings, scene=scene)
    arm = BarrierInputs(desired, seen, motion, none, None, True, Pose.identity())
    return Situation.of((arm,), Surroundings({}, inputs))
