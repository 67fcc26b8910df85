"""Text and values of the event `load_unexplained`."""

import math

import numpy as np

from ..control.spatial import GRAVITY, Array, sizes
from ..runtime.events import Value


def explanation(wrench: Array, unloaded: Array | None) -> tuple[str, dict[str, Value]]:
    """Return what to say of a wrench (6,) in World axes, and its values.

    `unloaded` (6,) is the sensor's reading, exerted sign, without the payload's weight: the bias
    that would explain it.
    """
    force, moment = sizes(wrench)
    up = float(wrench[2])
    tilt = math.degrees(math.acos(min(1.0, abs(up) / force))) if force > 0.0 else 90.0
    mass = up / -float(GRAVITY[2])
    values: dict[str, Value] = {
        "force_n": force,
        "moment_nm": moment,
        "force_world": str(np.round(wrench[:3], 2).tolist()),
        "moment_world": str(np.round(wrench[3:], 3).tolist()),
        "mass_kg": mass,
        "off_vertical_deg": tilt,
    }
    less = "more" if mass >= 0.0 else "less"
    words = f"{abs(mass):.2f} kg {less} than was told would, {tilt:.0f} deg off the vertical"
    if unloaded is not None:
        bias = np.round(-unloaded, 3).tolist()
        values["bias"] = str(bias)
        words += f"; or a bias of {bias}"
    return (
        f"{force:.1f} N and {moment:.2f} N·m that no contact explains: {words}. Force control and "
        "following wait for a tare, the payload, or an acknowledgement",
        values,
    )
