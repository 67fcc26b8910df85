"""`telerobot doctor`: fitness of this machine for a daemon, and advice."""

import argparse
import os
import platform
from collections.abc import Iterator
from typing import Final

from ...config.load import load_cell
from ...drivers.bus import can_interfaces, kernel_can_refusal, vcan_available
from ...server.process import LATENCY, let_sleep, stay_awake
from ..checks.cell import network
from ..checks.findings import Finding, Severity, failed, graded, summary, table, to_json
from ..host import machine

PERIOD_S: Final = 0.002
LATE_S: Final = 0.001
"""Worth a warning: wake-ups later than this at p99 are noticed in a period of 10 ms [s]."""
TOO_LATE_S: Final = 0.005


def examine(duration_s: float = 2.0) -> Iterator[Finding]:
    """Yield what was found; measures the timer for about `duration_s`."""
    cores = len(os.sched_getaffinity(0))
    yield Finding(
        "cores",
        Severity.OK if cores >= 2 else Severity.WARN,
        f"{cores}" + ("" if cores >= 2 else ": the daemon wants one of its own"),
        {"cores": cores, "python": platform.python_version(), "kernel": platform.release()},
    )
    name = machine.governor()
    yield Finding(
        "CPU governor",
        Severity.OK if name in (None, "performance") else Severity.WARN,
        {None: "not readable here", "performance": "performance"}.get(
            name, f"{name}: 'performance' wakes up sooner"
        ),
        {"governor": name},
    )
    yield _granted(
        "memory lock",
        machine.memory_lock_refusal(),
        "a page fault can stall a tick; grant memlock in /etc/security/limits.conf",
    )
    yield _granted(
        "CPU sleep",
        stay_awake(),
        f"a processor that sleeps deeply wakes up late; let the daemon's user write {LATENCY}",
    )
    with machine.realtime() as refusal:
        yield _granted(
            "SCHED_FIFO",
            refusal,
            "other programs can delay a tick; grant rtprio in /etc/security/limits.conf",
        )
        late = machine.measure_jitter(duration_s, PERIOD_S)
        yield Finding(
            "timer",
            graded(late.p99, LATE_S, TOO_LATE_S),
            f"late by {late.p50 * 1e6:.0f} µs p50, {late.p99 * 1e6:.0f} µs p99, "
            f"{late.max * 1e6:.0f} µs at most, in {late.wakeups} wake-ups, "
            f"{'without' if refusal else 'with'} SCHED_FIFO",
            {
                "p50_s": late.p50,
                "p99_s": late.p99,
                "max_s": late.max,
                "wakeups": late.wakeups,
                "sched_fifo": not refusal,
            },
        )
    let_sleep()
    refusal = machine.loopback_refusal()
    yield Finding(
        "loopback bus",
        Severity.ERROR if refusal else Severity.OK,
        refusal or "CAN frames cross between processes on 127.0.0.1",
    )
    refusal, vcan = kernel_can_refusal(), vcan_available()
    listed = ", ".join(f"{name} {state}" for name, state in can_interfaces().items())
    text = f"{listed or 'no interface'}; vcan {'available' if vcan else 'not available'}"
    text = f"none in this kernel ({refusal})" if refusal else text
    text += "" if listed else "; only real drives need it"
    yield Finding("kernel CAN", Severity.OK, text, {"interfaces": listed, "vcan": vcan})
    threads = os.environ.get("OPENBLAS_NUM_THREADS")
    yield Finding(
        "BLAS threads",
        Severity.OK if threads == "1" else Severity.WARN,
        f"OPENBLAS_NUM_THREADS is {threads or 'not set'}"
        + ("; set it to 1 in scripts of your own too" if threads == "1" else ": set it to 1"),
        {"openblas_num_threads": threads},
    )
    found = machine.versions()
    missing = ", ".join(name for name, number in found.items() if number is None)
    yield Finding(
        "packages",
        Severity.ERROR if missing else Severity.OK,
        f"missing: {missing}" if missing else ", ".join(f"{n} {v}" for n, v in found.items()),
        {name: number for name, number in found.items() if number is not None},
    )
    made, how = machine.pictures()
    yield Finding(
        "pictures",
        Severity.OK if made else Severity.WARN,
        how if made else f"{how}; everything else works without",
    )


def run(args: argparse.Namespace) -> int:
    """Print the findings; return 0 if the machine is fit, else 1. Raises `ConfigError`."""
    findings = list(examine(args.seconds))
    findings += [] if args.cell is None else network(load_cell(args.cell))
    unfit = failed(findings)
    if args.json:
        print(to_json({"fit": not unfit}, findings))
    else:
        print(table(findings))
        print(f"{'not fit' if unfit else 'fit'} for a demo: {summary(findings)}")
    return 1 if unfit else 0


def _granted(check: str, refusal: str, otherwise: str) -> Finding:
    if refusal:
        return Finding(check, Severity.WARN, f"{refusal}: {otherwise}", {"granted": False})
    return Finding(check, Severity.OK, "granted", {"granted": True})
