"""The virtual hardware: physics, one simulated CAN node per file, and rendered cameras."""

import ctypes
import os

_OSMESA = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")


def _osmesa() -> bool:
    """Return whether the library that renders without a graphics card can be loaded."""
    for name in _OSMESA:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


# MuJoCo chooses its renderer when it is imported, which modules of this package do.
if "MUJOCO_GL" not in os.environ and _osmesa():
    os.environ["MUJOCO_GL"] = "osmesa"
