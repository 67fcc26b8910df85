"""What the rig's geoms have in common: who touches whom and how hard, and how poses are written."""

import mujoco
import numpy as np

from ...config.section import Pose

ARM, FIXED = 1, 2
"""Contact groups; fixed things never meet."""
SOLREF = (0.004, 1.0)
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


def quaternion(pose: Pose) -> tuple[float, float, float, float]:
    """Return a pose's rotation (fixed-axis roll, pitch, yaw) as MuJoCo's w, x, y, z."""
    quat = np.zeros(4)
    mujoco.mju_euler2Quat(quat, np.array(pose.rpy), "XYZ")
    w, x, y, z = quat.tolist()
    return w, x, y, z
