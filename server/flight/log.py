"""The last seconds of ticks: what went in as bytes, what came out, and now and then the memory.

A tick's row holds bytes only, so that it costs the garbage collector nothing. Memories follow from
each other: one of them is kept every `KEY_EVERY` ticks, and wherever one did not come from the tick
before. From there on, inputs alone tell how it went on (`replay`).
"""

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import msgpack

from ..control.state import Inputs, Memory, Output
from ..mode import Mode
from .packer import InputsPacker
from .values import RecordedValueError, pack, unpack

SECONDS: Final = 30.0
"""Length of the log [s]."""

KEY_EVERY: Final = 100
"""Ticks between two memories that are kept [1]."""


class KeptTick(NamedTuple):
    """One tick as it is kept."""

    tick: int
    stamp_ns: int
    """Wall clock [ns]."""
    data: bytes
    """See `ReadTick`."""
    memories: tuple[Memory, ...] | None
    """Memory that the tick began with, where that is kept."""


class ReadTick(NamedTuple):
    """One tick as it is read again."""

    number: int
    """Rows before it, since the daemon began."""
    tick: int
    time_s: float
    mode: str
    goes_on: bool
    """It began with the memories that the tick before ended with."""
    inputs: tuple[Inputs, ...]
    told: tuple[Any, ...]
    """Outputs of each arm, as `told` takes them; none where the tick raised."""


def told(output: Output) -> tuple[Any, ...]:
    """Return what is kept of an output: all that is sent, and what decided it, to the last bit."""
    return (
        output.q.tobytes(),
        output.dq.tobytes(),
        output.command.tobytes(),
        output.following_error.tobytes(),
        output.twist.tobytes(),
        output.scale,
        output.sigma_min,
        output.at_rest,
        output.at_goal,
        output.bleeding,
        output.stop_worsened,
        output.refusal,
        output.limits,
    )


TOLD: Final = (
    "q", "dq", "command", "following_error", "twist", "scale", "sigma_min", "at_rest", "at_goal",
    "bleeding", "stop_worsened", "refusal", "limits",
)  # fmt: skip
"""Names of what `told` returns."""


def read_row(data: bytes) -> ReadTick:
    """Return the tick of a row's data. Raises `RecordedValueError`."""
    try:
        number, tick, time_s, mode, goes_on, inputs, outputs = msgpack.unpackb(data, use_list=False)
    except (ValueError, TypeError, msgpack.UnpackException) as error:
        raise RecordedValueError(f"no tick: {error}") from None
    return ReadTick(number, tick, time_s, mode, goes_on, tuple(map(unpack, inputs)), outputs)


class FlightLog:
    """Keeps the rows of the newest ticks of one cell."""

    def __init__(self, period_s: float, arms: int, wall_ns: Callable[[], int] = time.time_ns):
        """Build it for so many arms; `wall_ns` tells the wall clock's time [ns]."""
        self.rows: deque[KeptTick] = deque(maxlen=max(KEY_EVERY, round(SECONDS / period_s)))
        self.taps: list[Callable[[KeptTick], None]] = []
        """Called with every row."""
        self._wall_ns = wall_ns
        self._packers = [InputsPacker() for _ in range(arms)]
        self._pack: Callable[[Any], bytes] = msgpack.Packer().pack
        self.lost = 0
        """Ticks that could not be recorded [1]."""
        self._count = 0
        self._nexts: Sequence[Memory] = ()

    def keep(
        self,
        tick: int,
        time_s: float,
        mode: Mode,
        memories: Sequence[Memory],
        inputs: Sequence[Inputs],
        nexts: Sequence[Memory],
        outputs: Sequence[Output],
    ) -> None:
        """Keep one tick: what it began with, looked at, ended with and decided, of each arm.

        A tick that raised has neither `nexts` nor `outputs`.
        """
        goes_on = len(self._nexts) == len(memories) and all(
            a is b for a, b in zip(memories, self._nexts, strict=True)
        )
        self._nexts = nexts
        self._count += 1
        try:
            given = [p.pack(x) for p, x in zip(self._packers, inputs, strict=True)]
        except TypeError:  # a value of a kind that this cannot record: the arm goes on all the same
            self.lost += 1
            return
        data = self._pack(
            (
                self._count - 1, tick, time_s, mode.value, goes_on, given, [*map(told, outputs)],
            )
        )  # fmt: skip
        key = tuple(memories) if not goes_on or tick % KEY_EVERY == 0 else None
        row = KeptTick(tick, self._wall_ns(), data, key)
        self.rows.append(row)
        for tap in self.taps:
            tap(row)


def pack_memories(memories: Sequence[Memory]) -> bytes:
    """Return memories as bytes."""
    return pack(tuple(memories))
