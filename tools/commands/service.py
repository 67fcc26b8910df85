"""`telerobot service CELL`: a systemd unit that runs the cell's daemon on this machine."""

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from string import Template
from typing import Final

from ...config.errors import ConfigError, printable
from ...config.load import Cell, load_cell, shipped
from ...server.process import LATENCY, PRIORITY

ISOLATED: Final = Path("/sys/devices/system/cpu/isolated")
_USER: Final = re.compile(r"[a-z_][a-z0-9_-]{0,31}")
_CPUS: Final = re.compile(r"\d{1,4}(-\d{1,4})?(,\d{1,4}(-\d{1,4})?)*")
_HOMES: Final = ("/home/", "/root/", "/run/user/")


def run(args: argparse.Namespace) -> int:
    """Print the unit. Raises `ConfigError`."""
    if not _USER.fullmatch(args.user):
        raise ConfigError(f"--user {printable(args.user)}: no name of a user")
    if args.cpus is not None and not _CPUS.fullmatch(args.cpus):
        raise ConfigError(f"--cpus {printable(args.cpus)}: a list such as 3 or 2-3 is wanted")
    print(unit(load_cell(args.cell), args.cell, args.user, args.cpus or _isolated()), end="")
    return 0


def unit(cell: Cell, asked: str, user: str, cpus: str) -> str:
    """Return the unit of a cell, which was `asked` for by name or path; "" are all processors."""
    place = asked if asked in shipped("cells") else str(cell.path.resolve())
    script = Path(sys.executable).with_name("telerobot")  # beside this interpreter, or by it
    program = [str(script)] if script.is_file() else [sys.executable, "-m", "telerobot"]
    command = [*program, "serve", place]
    no_devices = all(bus.interface in ("socketcan", "loopback") for bus in cell.config.fieldbuses)
    at_home = any(word.startswith(_HOMES) for word in command)
    template = Template(Path(__file__).with_name("unit.service").read_text(encoding="utf-8"))
    return template.substitute(
        name=cell.config.name,
        user=user,
        description=printable(cell.config.description).replace("%", "%%") or "control server",
        buses="".join(f"\n{line}" for line in _buses(cell)),
        command=" ".join(_quoted(word) for word in command),
        priority=PRIORITY,
        cpus=f"\nCPUAffinity={cpus}" if cpus else "",
        homes="read-only" if at_home else "yes",
        devices=f"\nDevicePolicy=closed\nDeviceAllow={LATENCY} rw" if no_devices else "",
    )


def _buses(cell: Cell) -> Iterator[str]:
    """Yield what waits for the network interfaces of the cell's CAN buses."""
    for bus in cell.config.fieldbuses:
        if bus.interface == "socketcan" and re.fullmatch(r"[A-Za-z0-9_]+", bus.channel):
            device = f"sys-subsystem-net-devices-{bus.channel}.device"
            yield f"Wants={device}"
            yield f"After={device}"


def _isolated() -> str:
    try:
        return ISOLATED.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def _quoted(word: str) -> str:
    """Return a word of a command line as systemd reads it. Raises `ConfigError`."""
    if printable(word) != word or any(c in word for c in "\"'\\"):
        raise ConfigError(f"{printable(word)}: a unit cannot name this path: move it")
    escaped = word.replace("%", "%%").replace("$", "$$")
    return f'"{escaped}"' if " " in escaped or ";" in escaped else escaped
