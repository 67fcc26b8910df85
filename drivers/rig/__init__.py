"""The virtual hardware: physics, one simulated CAN node per file, and virtual cameras."""

import ctypes
import os

_LIBRARIES = {
    "osmesa": ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"),
    "egl": ("libEGL.so.1",),
}
"""OpenGL without a display, by MuJoCo's names."""


def _opengl() -> str:
    """Return what MuJoCo shall render with: what can be loaded here, a display, or nothing."""
    for kind, names in _LIBRARIES.items():
        for name in names:
            try:
                ctypes.CDLL(name)
            except OSError:
                continue
            return kind
    return "glfw" if os.environ.get("DISPLAY") else "disable"


# MuJoCo chooses its renderer when it is imported, which modules of this package do.
if "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = _opengl()
