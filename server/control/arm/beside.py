"""Joint rates that are asked for beside the twists of a task, added to one arm's own."""

from ..mechanism.joint_motion import FOLDING
from ..mechanism.kinematics import Kinematics
from ..spatial import Array
from ..state import Inputs
from .stages import Stages


def with_beside(
    dq: Array,
    twists: dict[str, Array],
    inputs: Inputs,
    k: Kinematics,
    q: Array,
    stages: Stages,
) -> tuple[Array, dict[str, Array]]:
    """Return joint rates (n,) and the sources' twists, with those of folding and of a sweep.

    At the commanded posture q (n,), whose kinematics are `k`. Joints that are led themselves do not
    fold.
    """
    fold, sweep = inputs.beside
    if fold is not None and inputs.posture is None and inputs.jog is None:
        z = fold.rates(q, k.J, stages.joint_motion, inputs.settings.speed_factor)
        dq, twists = dq + z, {**twists, FOLDING: k.J @ z}
    if sweep is not None:
        dq = dq.copy()
        dq[sweep[0]] = sweep[1]
    return dq, twists
