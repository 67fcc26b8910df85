"""Runs a command on a machine that has vcan0: `python tests/vcan/run.py COMMAND ...`.

This one, where its kernel has CAN; else a user-mode Linux (Debian's package `user-mode-linux`),
which needs no rights and has this machine's files, one processor, a network of its own and a clock
that goes slower than ours, so that slow system calls leave time enough for a period of 10 ms.
Returns the command's exit code, and 77, with the reason, where neither is to be had.
"""

import argparse
import ctypes
import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).resolve().parent
KERNEL: Final = "linux.uml"
MODULES: Final = Path("/usr/lib/uml/modules")
WANTED: Final = (
    "net/can/can",
    "net/can/can-raw",
    "drivers/net/can/dev/can-dev",
    "drivers/net/can/vcan",
)
"""Modules in the order of loading; `can-dev` is not needed by every kernel."""

SKIPPED: Final = 77
BUSES: Final = 2
POLL_S: Final = 0.1
_SUBREAPER: Final = 36  # linux/prctl.h

INIT: Final = """#!/bin/sh
# The first and only program of the guest.
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t tmpfs tmp /mnt
mkdir -p /dev/shm
mount -t tmpfs shm /dev/shm
PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
export PATH
{modules}
ip link set lo up
{links}
ip link show vcan0 >{up} || echo o >/proc/sysrq-trigger
cd {folder}
{environment} sh -c {command} >{out} 2>&1 </dev/null
echo $? >{code}.part
mv {code}.part {code}
sync
echo o >/proc/sysrq-trigger
sleep 60
"""


def has_can() -> bool:
    """Return whether this kernel has vcan0, or can be given it."""
    try:
        socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    for i in range(BUSES):
        if not Path(f"/sys/class/net/vcan{i}").exists():
            for line in link(i).splitlines():
                subprocess.run(shlex.split(line), check=False, capture_output=True)
    return Path("/sys/class/net/vcan0").exists()


def link(i: int) -> str:
    """Return the commands that make a virtual CAN bus."""
    return f"ip link add dev vcan{i} type vcan\nip link set vcan{i} up"


def lacking() -> str:
    """Return why there can be no user-mode Linux here; empty where there can."""
    if shutil.which(KERNEL) is None or not MODULES.is_dir():
        return "no vcan in this kernel and no user-mode Linux: apt-get install user-mode-linux"
    for tool, package in (("insmod", "kmod"), ("ip", "iproute2")):
        if shutil.which(tool, path="/usr/sbin:/sbin:/usr/bin:/bin") is None:
            return f"user-mode Linux needs {tool}: apt-get install {package}"
    if shutil.which("gcc") is None:
        return "user-mode Linux needs gcc for what is preloaded: apt-get install gcc libc6-dev"
    return ""


def large_state() -> bool:
    """Return whether the processor's extended state is larger than the guest's kernel knows."""
    return "amx_tile" in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")


def preloaded(folder: Path) -> str:
    """Compile what the guest's kernel needs of this machine's; return it as `LD_PRELOAD`."""
    libraries = []
    for name in ("whole_xstate", "slow_clock") if large_state() else ("slow_clock",):
        libraries.append(str(folder / f"{name}.so"))
        source = str(HERE / f"{name}.c")
        flags = ["-O1", "-shared", "-fPIC"]
        subprocess.run(["gcc", *flags, "-o", libraries[-1], source, "-ldl"], check=True)
    return ":".join(libraries)


def boot(command: list[str], folder: Path, seconds: float, memory: str, slower: int) -> int:
    """Run a command in a user-mode Linux; return its exit code, 1 where it did not end in time.

    77 where the guest did not come up, as where processes may not be traced.
    """
    (kernel_modules,) = MODULES.iterdir()
    paths = [kernel_modules / "kernel" / f"{name}.ko" for name in WANTED]
    out, code, init, up = (folder / name for name in ("out", "code", "init", "up"))
    kept = {
        k: v for k, v in os.environ.items() if k.startswith(("PYTHON", "TELEROBOT", "OPENBLAS"))
    }
    kept |= {"PATH": os.environ["PATH"], "HOME": "/mnt", "TMPDIR": "/mnt", "TELEROBOT_CAN": "vcan"}
    out.touch()
    init.write_text(
        INIT.format(
            modules="\n".join(f"insmod {path}" for path in paths if path.exists()),
            links="\n".join(link(i) for i in range(BUSES)),
            folder=shlex.quote(os.getcwd()),
            environment=" ".join(f"{k}={shlex.quote(v)}" for k, v in kept.items()),
            command=shlex.quote(shlex.join(command)),
            out=out,
            code=code,
            up=up,
        ),
        encoding="utf-8",
    )
    init.chmod(0o755)
    environment = {
        **os.environ,
        "TMPDIR": "/dev/shm",
        "LD_PRELOAD": preloaded(folder),
        "SLOWER": str(slower),
    }
    # What a guest's process is on this machine is our child once the guest's kernel has ended.
    ctypes.CDLL(None).prctl(_SUBREAPER, 1, 0, 0, 0)
    arguments = [
        f"mem={memory}", "root=none", "rootfstype=hostfs", "rootflags=/", "rw", f"init={init}",
        "panic=-1", "con=null", "con0=null,fd:1", "ssl=null", f"uml_dir={folder}", "quiet",
    ]  # fmt: skip
    with (folder / "console").open("wb") as console:
        guest = subprocess.Popen(
            [KERNEL, *arguments], stdin=subprocess.DEVNULL, stdout=console, stderr=console,
            env=environment, start_new_session=True,
        )  # fmt: skip
    try:
        follow(guest, out, seconds)
    finally:
        guest.kill()
        guest.wait()
        reap()
    if code.exists():
        return int(code.read_text(encoding="ascii"))
    told = (folder / "console").read_text(encoding="utf-8", errors="replace")[-3000:]
    if not up.exists() or not up.read_text(encoding="ascii"):
        print(f"{told}\nskipped: user-mode Linux gives no vcan0 here", file=sys.stderr)
        return SKIPPED
    print(f"{told}\nthe command did not end within {seconds:g} s", file=sys.stderr)
    return 1


def follow(guest: "subprocess.Popen[bytes]", out: Path, seconds: float) -> None:
    """Print what the command prints, until the guest ends or the time is up."""
    end_s = time.monotonic() + seconds
    with out.open("rb") as told:
        while True:
            over = guest.poll() is not None or time.monotonic() > end_s
            sys.stdout.buffer.write(told.read())
            sys.stdout.flush()
            if over:
                return
            time.sleep(POLL_S)


def reap() -> None:
    """End what is left of the guest: children of this process, and of none other."""
    own = Path(f"/proc/self/task/{os.getpid()}/children")
    while children := own.read_text(encoding="ascii").split():
        for child in children:
            os.kill(int(child), signal.SIGKILL)
            os.waitpid(int(child), 0)


def main() -> int:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=900.0, help="how long it may take")
    parser.add_argument("--memory", default="3G", help="memory of the guest")
    parser.add_argument(
        "--slower", type=int, default=12, metavar="N", help="a second of the guest takes N of ours"
    )
    parser.add_argument("--guest", action="store_true", help="in user-mode Linux in any case")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    args = parser.parse_args()
    if not args.guest and has_can():
        environment = {**os.environ, "TELEROBOT_CAN": "vcan"}
        return subprocess.run(args.command, env=environment, check=False).returncode
    why = lacking()
    if why:
        print(f"skipped: {why}", file=sys.stderr)
        return SKIPPED
    with tempfile.TemporaryDirectory(prefix="vcan-") as folder:
        return boot(args.command, Path(folder), args.seconds, args.memory, args.slower)


if __name__ == "__main__":
    sys.exit(main())
