"""`telerobot plot`: pictures of a recorded run."""

from importlib.util import find_spec

from ....drivers.device import DeviceError


def require_matplotlib() -> None:
    """Raise `DeviceError` where there is nothing to draw with."""
    if find_spec("matplotlib") is None:
        raise DeviceError("nothing to draw with: pip install 'telerobot[plot]'")
