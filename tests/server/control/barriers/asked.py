"""An arm in a tick, as the barriers see it."""

import numpy as np
from telerobot.server.control.bodies.rates import ArmTick, JointRates
from telerobot.server.control.hold import COMMANDED
from telerobot.server.control.inputs import Inputs, Intent, ObjectiveGains, Settings
from telerobot.server.control.mechanism.redundancy import SelfMotion
from telerobot.server.control.spatial import Pose
from telerobot.server.control.stop.limiter import Commanded
from telerobot.server.control.stop.profile import Stop


def situation(k, dq, motion, scene):
    """Return what is watched of an arm that follows rates dq (n,) at once."""
    none = np.zeros(len(dq))
    told = Commanded(motion, Stop.at_rest(motion.q), (motion.q,) * 3)
    settings = Settings({}, Pose.identity(), Pose.identity(), np.zeros(6))
    inputs = Inputs(0.0, Intent.MOVE, motion.q, settings, scene=scene)
    arm = ArmTick(inputs, k, k.T_world_wrist, none, told, stance=COMMANDED, moving_since_s=0.0)
    arm.objectives = ObjectiveGains({}, none)
    arm.dq_asked, arm.found = dq, JointRates(dq, SelfMotion(none, {}))
    return (arm,), motion, {}, (), dq
