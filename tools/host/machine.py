"""What this machine is fit for, and which processes it runs already."""

import atexit
import ctypes
import errno
import os
import re
import secrets
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.metadata import distributions, requires
from pathlib import Path
from typing import Final

from ...config.load import Cell, load_cell
from ...config.schema.bus import BusSection
from ...config.schema.network import SECURE, beyond_loopback
from ...drivers.bus import open_bus
from ...drivers.device import DeviceError
from ...drivers.fieldbus import Fieldbus

# --- Rights and timing of this machine; Linux, as the daemon needs it -----------------------------
PRIORITY: Final = 50
_MCL_CURRENT: Final = 1
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


def wakeups(
    duration_s: float,
    period_s: float,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> list[float]:
    """Sleep to absolute deadlines for a while; return how late each wake-up was [s]."""
    start = now()
    late: list[float] = []
    for i in range(1, max(1, round(duration_s / period_s)) + 1):
        deadline = start + i * period_s
        left = deadline - now()
        if left > 0:
            sleep(left)
        late.append(now() - deadline)
    return late


def measure_jitter(
    duration_s: float,
    period_s: float,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Jitter:
    """Sleep to absolute deadlines for a while; return how late the wake-ups were."""
    late = sorted(max(0.0, each) for each in wakeups(duration_s, period_s, now, sleep))
    count = len(late)
    return Jitter(count, late[count // 2], late[min(count - 1, (99 * count) // 100)], late[-1])


def governor(root: Path = Path("/sys/devices/system/cpu")) -> str | None:
    """Return the frequency governor of the first core, None where it cannot be read."""
    try:
        return (root / "cpu0/cpufreq/scaling_governor").read_text().strip()
    except OSError:
        return None


def versions(*packages: str) -> dict[str, str | None]:
    """Return each package's version, by default of all that `telerobot` needs; None: not here."""
    needed = (
        re.split(r"[^\w.-]", line)[0] for line in requires("telerobot") or () if "extra" not in line
    )
    here = {re.sub("_", "-", str(found.name)).lower(): found.version for found in distributions()}
    return {name: here.get(name.lower()) for name in packages or ("telerobot", *needed)}


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


# --- Endpoint and port of a demo: the cell's own, or another one, and why -------------------------
PRIVATE: Final = range(20_000, 32_000)
"""Ports that are given away: below those that the kernel gives to whoever names none [1]."""


class Claims:
    """Ports of this machine that this process has claimed, until it ends.

    Two that start at once would both find a port free, and a server binds it only seconds later; a
    name in the abstract namespace is one's at once.
    """

    def __init__(self) -> None:
        self._names = ExitStack()

    def take(self, port: int, kind: socket.SocketKind = socket.SOCK_STREAM) -> str:
        """Claim a port of 127.0.0.1; return in words why that cannot be, or nothing."""
        name = socket.socket(socket.AF_UNIX)
        try:
            name.bind(f"\0telerobot-{port}")
        except OSError:
            name.close()
            return "another demo has it"
        with socket.socket(type=kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError as error:
                name.close()
                return "it is in use" if error.errno == errno.EADDRINUSE else str(error.strerror)
        self._names.enter_context(name)
        return ""

    def close(self) -> None:
        """Let go of all."""
        self._names.close()


_ours: Final = Claims()
atexit.register(_ours.close)


def free_port(kind: socket.SocketKind) -> int:
    """Return a port of 127.0.0.1 that nobody uses, and that nobody else is given meanwhile.

    Raises `OSError` where all that are given away are taken.
    """
    first = secrets.randbelow(len(PRIVATE))
    port: int
    for port in (*PRIVATE[first:], *PRIVATE[:first]):
        if not _ours.take(port, kind):
            return port
    raise OSError(errno.EADDRINUSE, f"no port of {PRIVATE.start} to {PRIVATE.stop - 1} is free")


def own_endpoint(cell: Cell, claims: Claims) -> tuple[str | None, str]:
    """Return the cell's own endpoint if a demo may listen there; else None, and why not."""
    zenoh = cell.config.zenoh
    if zenoh.router is not None:
        return None, f"{zenoh.router} is a common router"
    secured = zenoh.security.directory is not None
    if beyond_loopback(zenoh.listen) or secured != zenoh.listen.startswith(SECURE):
        return None, f"{zenoh.listen} is not for this machine alone"
    port = zenoh.listen.rpartition(":")[2]
    if not port.isdecimal():
        return None, f"{zenoh.listen} names no port"
    why = claims.take(int(port))
    return (None, f"{zenoh.listen}: {why}") if why else (zenoh.listen, "")
