"""Rights and timing of this machine; Linux, as the daemon needs it."""

import ctypes
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ...config.load import load_cell
from ...config.schema.bus import BusSection
from ...drivers.bus import open_bus
from ...drivers.device import DeviceError
from ...drivers.fieldbus import Fieldbus

PRIORITY: Final = 50
_MCL_CURRENT: Final = 1
_ARPHRD_CAN: Final = "280"
_PROBE: Final = BusSection(channel="239.74.163.250", port=43999)
_PROBE_ID: Final = 0x123
_PROBE_DATA: Final = b"telerobo"


@dataclass(frozen=True)
class Jitter:
    """Lateness of a loop of absolute sleeps [s]."""

    wakeups: int
    p50: float
    p99: float
    max: float


@contextmanager
def realtime() -> Iterator[str]:
    """Run with SCHED_FIFO where granted; yields what was refused, or nothing."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        yield error.strerror or str(error)
        return
    try:
        yield ""
    finally:
        os.sched_setscheduler(0, *before)


def memory_lock_refusal() -> str:
    """Lock this process's memory, unlock it again; return why not, or nothing."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT) != 0:
        return os.strerror(ctypes.get_errno())
    libc.munlockall()
    return ""


def measure_jitter(
    duration_s: float,
    period_s: float,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Jitter:
    """Sleep to absolute deadlines for a while; return how late the wake-ups were."""
    count = max(1, round(duration_s / period_s))
    start = now()
    late: list[float] = []
    for i in range(1, count + 1):
        deadline = start + i * period_s
        left = deadline - now()
        if left > 0:
            sleep(left)
        late.append(max(0.0, now() - deadline))
    late.sort()
    return Jitter(count, late[count // 2], late[min(count - 1, (99 * count) // 100)], late[-1])


def governor(root: Path = Path("/sys/devices/system/cpu")) -> str | None:
    """Return the frequency governor of the first core, None where it cannot be read."""
    try:
        return (root / "cpu0/cpufreq/scaling_governor").read_text().strip()
    except OSError:
        return None


def can_interfaces(root: Path = Path("/sys/class/net")) -> dict[str, str]:
    """Return the kernel's CAN interfaces with their state, such as `up`."""
    found: dict[str, str] = {}
    for device in sorted(root.glob("*")):
        try:
            if (device / "type").read_text().strip() == _ARPHRD_CAN:
                found[device.name] = (device / "operstate").read_text().strip()
        except OSError:
            continue  # an interface that went away while we looked
    return found


def kernel_can_refusal() -> str:
    """Return why this kernel opens no CAN socket, or nothing."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return error.strerror or str(error)
    return ""


def vcan_available(root: Path = Path("/sys/module"), modules: Path = Path("/lib/modules")) -> bool:
    """Return whether the kernel has virtual CAN, loaded or as a module."""
    here = modules / os.uname().release / "kernel/drivers/net/can"
    return (root / "vcan").exists() or any(here.glob("vcan.ko*"))


def loopback_refusal(bus: BusSection = _PROBE, timeout_s: float = 0.5) -> str:
    """Send a frame over the loopback CAN bus; return why it did not arrive, or nothing."""
    got: list[bytes] = []
    try:
        sender = Fieldbus(open_bus(bus))
        try:
            receiver = Fieldbus(open_bus(bus))
            try:
                receiver.listen(_PROBE_ID, lambda data, _stamp: got.append(bytes(data)))
                sender.send(_PROBE_ID, _PROBE_DATA)
                receiver.wait_until(lambda: _PROBE_DATA in got, timeout_s)
            finally:
                receiver.close()
        finally:
            sender.close()
    except DeviceError as error:
        return str(error)
    return "" if _PROBE_DATA in got else f"no frame came back within {timeout_s:g} s"


def pictures() -> tuple[bool, str]:
    """Return whether pictures can be made and looked at here, and how, or why not."""
    try:
        from ...drivers.rig.physics.camera import RigCameras

        cameras = RigCameras(load_cell("pa10_vision"))
    except DeviceError as error:
        return False, str(error)
    cameras.close()
    if cameras.drawn:
        return True, f"drawn without OpenGL ({cameras.drawn}); libosmesa6 renders them with light"
    return True, "can be rendered and looked at"
