"""Junk at 10,000 messages a second, from a process without any secret, costs no tick.

On the keepalive's key it is as much as a process can, and nothing else renews the lease.

Judged by the daemon's own count of overruns, against a quiet time of the same run.
"""

import math
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

FLOODER = Path(__file__).parent / "flooder.py"
FLOOD_S, RATE = 3.0, 10_000
MOST = 60_000
"""Of a flood of keepalives [1/s]."""

NOISE = 5
"""Overruns that a machine with other work may have in one flood and not in another [1]."""

KEPT_MB = 15.0
"""Of memory that the same floods may add when they come again [MB]; `nested` alone, kept, is 27.

The first ones are not judged by it: what the allocator took for a burst, some 20 MB, it keeps.
"""

pytestmark = [pytest.mark.hil, pytest.mark.alone]


def resident_mb(process):
    lines = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii").splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024


@pytest.mark.parametrize(
    "kinds",
    [
        ("random", "nested", "forged", "wellformed"),
        ("random@cmd/*", "forged@cmd/keepalive", "nested@sensor/obstacle"),
        ("wellformed@operator/lease", "random@operator/**", "nested@operator/protective_stop"),
        ("huge", "deaf"),
        ("forged@cmd/keepalive", "random@cmd/keepalive", "forged@cmd/*"),
    ],
    ids=["all keys", "puts", "requests", "huge and deaf", "keepalives"],
)
def test_a_flood_costs_no_tick_no_memory_and_not_the_lease(plant, kinds):
    operator = plant.enabled_operator()
    on_keepalives = kinds[0] == "forged@cmd/keepalive"
    if not on_keepalives:
        operator.joystick([0, 0, 0.005, 0, 0, 0], expressed_in="base")

    def overruns_of(turn):
        before = operator.state.overruns
        turn()
        return operator.state.overruns - before

    quiet = overruns_of(lambda: plant.run_for(FLOOD_S))
    before_mb = math.inf
    for n, kind in enumerate((*kinds, *kinds)):
        if n == len(kinds):
            before_mb = resident_mb(plant.daemon)
        rate = 5 if kind == "huge" else MOST if on_keepalives else RATE
        arguments = [plant.cell.config.zenoh.listen, "pa10", kind, str(rate), str(FLOOD_S)]
        with subprocess.Popen(
            [sys.executable, FLOODER, *arguments], stdout=subprocess.PIPE
        ) as child:
            flooded = overruns_of(
                lambda: plant.until(lambda: child.poll() is not None, 60.0, "the flood did not end")
            )
            sent = int(child.stdout.read())
        assert sent > rate * FLOOD_S / 3, kind
        assert flooded <= quiet + NOISE, kind
        assert resident_mb(plant.daemon) - before_mb < KEPT_MB, kind
        assert operator.holds_lease, kind
        assert (operator.state.mode, operator.state.protective_stop) == ("enabled", False), kind
    before = plant.truth.pose_mrf[2]
    plant.run_for(1.0)
    assert plant.truth.pose_mrf[2] - before == pytest.approx(
        0.0 if on_keepalives else 0.005, abs=2e-3
    )


def test_two_floods_of_requests_on_a_busy_machine_cost_no_fault(plant):
    """Sixteen processes take the time they can; requests to change the mode come from two more.

    The test's own operator may be kept silent by them, for longer than a lease lasts: then the arm
    has to be in HOLD.
    """
    operator = plant.enabled_operator()
    before = operator.state.overruns
    arguments = [plant.cell.config.zenoh.listen, "pa10", "wellformed@operator/mode", str(RATE), "8"]
    flood = [sys.executable, FLOODER, *arguments]
    busy = [sys.executable, "-c", "while True: pass"]
    with ExitStack() as ends:
        for command in (*16 * [busy], flood, flood):
            child = ends.enter_context(subprocess.Popen(command, stdout=subprocess.DEVNULL))
            ends.callback(child.kill)
        plant.run_for(10.0)
    plant.run_for(1.0)
    silent = "lease_expired" in [event.name for event in operator.events]
    assert operator.state.mode == ("hold" if silent else "enabled"), plant.told()
    assert not operator.state.protective_stop
    assert operator.state.overruns - before <= 4 * NOISE
