"""Common to the rig's geoms: who touches whom and how hard, and how poses are written."""

import mujoco
import numpy as np

from ....config.schema.section import PoseSection

ARM, FIXED = 1, 2
"""Contact groups; fixed things never meet."""
SOLREF = (0.004, 1.0)
SLIDING_SOLREF = (0.04, 1.0)
"""Of friction where the tool slides. MuJoCo's contacts are convex: what slips is lifted by as much
as slip is damped, at 4 ms by 0.4 mm at 0.05 m/s, where contact ends. The tool would hop, closed for
a millisecond and open for four."""
SOLIMP = (0.95, 0.99, 0.001, 0.5, 2.0)


def of_arm(geom: mujoco.MjsGeom) -> mujoco.MjsGeom:
    """Make a geom touch like a part of the arm; return it."""
    geom.contype, geom.conaffinity = ARM, ARM | FIXED
    geom.solref[:], geom.solimp[:] = SOLREF, SOLIMP
    return geom


def fixed(geom: mujoco.MjsGeom) -> mujoco.MjsGeom:
    """Make a geom touch like a thing that stands around; return it."""
    geom.contype, geom.conaffinity = FIXED, ARM
    geom.solref[:], geom.solimp[:] = SOLREF, SOLIMP
    return geom


def slides_on(spec: mujoco.MjSpec, tool: str, surface: mujoco.MjsGeom) -> None:
    """Let a geom of the tool slide on a surface without hopping; friction is as it was."""
    pair = spec.add_pair(geomname1=tool, geomname2=surface.name)
    pair.condim, pair.friction[:] = surface.condim, np.repeat(surface.friction, (2, 1, 2))
    pair.solref[:], pair.solreffriction[:], pair.solimp[:] = SOLREF, SLIDING_SOLREF, SOLIMP


def quaternion(pose: PoseSection) -> tuple[float, float, float, float]:
    """Return a pose's rotation (fixed-axis roll, pitch, yaw) as MuJoCo's w, x, y, z."""
    quat = np.zeros(4)
    mujoco.mju_euler2Quat(quat, np.array(pose.rpy), "XYZ")
    w, x, y, z = quat.tolist()
    return w, x, y, z
