"""Runs the pure tick on recorded inputs, and compares what comes out bit by bit."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ....config.load import Cell
from ....server.control.state import Inputs, Memory, Output
from ....server.control.tick import Control
from ....server.recorder import (
    MEMORY,
    TICK,
    TOLD,
    ReadTick,
    RecordedValueError,
    pack,
    pack_memories,
    read_row,
    told,
    unpack,
)
from ..run_file import Recorded, RecordError, read_run

_ARRAYS = ("q", "dq", "command", "following_error", "twist")


class Replayed(NamedTuple):
    """One tick that was computed again."""

    record: ReadTick
    before: tuple[Memory, ...]
    nexts: tuple[Memory, ...]
    outputs: tuple[Output, ...]
    raised: str | None
    """Error that the tick raised, in one line."""
    difference: str | None
    """First output that differs from the record; None where none does."""
    stamp_ns: int = 0
    """Time of day of the recording [ns]."""

    @property
    def inputs(self) -> tuple[Inputs, ...]:
        """Inputs of the tick, of each arm."""
        return self.record.inputs


@dataclass
class Judgement:
    """Figures of a replay."""

    ticks: int = 0
    """Ticks that were computed again."""
    memories: int = 0
    """Memories that were compared, too."""
    skipped: int = 0
    """Ticks for which no memory was there to begin with."""
    first_s: float | None = None
    """Time of the first recorded tick, on the daemon's clock [s]."""
    last_s: float | None = None
    difference: str | None = None


class Replay:
    """Replays one recording with the cell that it holds; `judgement` is complete in the end."""

    def __init__(self, path: Path, cell: Cell) -> None:
        """Build it. Raises `ConfigError` for a cell that this version does not take."""
        self._path, self._control = path, Control.of(cell)
        self.judgement = Judgement()

    def run(self) -> Iterator[Replayed]:
        """Yield tick by tick. Raises `RecordError` for a file without ticks, or another version's.

        It goes on after a difference, with what was computed here.
        """
        try:
            yield from self._run(read_run(self._path, (TICK, MEMORY)))
        except RecordedValueError as error:
            raise RecordError(f"{self._path}: {error}") from None
        if self.judgement.first_s is None:
            raise RecordError(f"{self._path}: holds no ticks: nothing to replay")

    def _run(self, messages: Iterable[Recorded]) -> Iterator[Replayed]:
        judgement = self.judgement
        memories: tuple[Memory, ...] | None = None
        key: bytes | None = None
        number = -1
        for message in messages:
            if message.topic == MEMORY:
                key = message.data
                continue
            record = read_row(message.data)
            judgement.last_s = record.time_s
            if judgement.first_s is None:
                judgement.first_s = record.time_s
            follows = record.goes_on and record.number == number + 1
            number = record.number
            difference = None
            if not follows:
                memories = None
            if key is not None:
                if memories is not None:
                    judgement.memories += 1
                    difference = _of_memories(memories, key)
                memories, key = unpack(key), None
            if memories is None:
                judgement.skipped += 1
                continue
            replayed = self._tick(record, memories, difference)
            judgement.ticks += 1
            if judgement.difference is None and replayed.difference is not None:
                judgement.difference = (
                    f"tick {record.tick}, {record.time_s:.3f} s: {replayed.difference}"
                )
            memories = replayed.nexts or None
            yield replayed._replace(stamp_ns=message.stamp_ns)

    def _tick(
        self, record: ReadTick, memories: tuple[Memory, ...], difference: str | None
    ) -> Replayed:
        try:
            nexts, outputs = self._control.tick(memories, record.inputs)
        except Exception as error:  # noqa: BLE001  what the daemon's tick raised, this one raises
            words = f"{type(error).__name__}: {error}"
            if difference is None and record.told:
                difference = f"raised here: {words}"
            return Replayed(record, memories, (), (), words, difference)
        return Replayed(
            record, memories, nexts, outputs, None, difference or _of_outputs(record, outputs)
        )


def _of_outputs(record: ReadTick, outputs: tuple[Output, ...]) -> str | None:
    """Return the first difference between recorded outputs and those of now."""
    if not record.told:
        return "it raised when it was recorded, and does not here"
    for arm, (then, now) in enumerate(zip(record.told, map(told, outputs), strict=True)):
        for name, a, b in zip(TOLD, then, now, strict=True):
            if a != b and not (a != a and b != b):  # what is not a number equals itself here
                where = f"{name} of arm {arm}" if len(outputs) > 1 else name
                return f"{where}: {_words(name, a)} recorded, {_words(name, b)} here"
    return None


def _words(name: str, value: Any) -> str:
    if name not in _ARRAYS or not isinstance(value, bytes):
        return repr(value)
    return np.array2string(np.frombuffer(value), precision=17, separator=", ")


def _of_memories(memories: tuple[Memory, ...], key: bytes) -> str | None:
    """Return the first difference between a recorded memory and that of now."""
    if pack_memories(memories) == key:
        return None
    return f"memory: {first_difference(unpack(key), memories) or 'another layout'}"


def first_difference(a: Any, b: Any, path: str = "") -> str | None:
    """Return where two values differ first, and how; None where they do not."""
    if type(a) is not type(b):
        return f"{path}: a {type(a).__name__} recorded, a {type(b).__name__} here"
    if isinstance(a, np.ndarray):
        same = a.shape == b.shape and a.tobytes() == b.tobytes()
        return None if same else f"{path}: {a} recorded, {b} here"
    if isinstance(a, dict):
        if list(a) != list(b):
            return f"{path}: keys {list(a)} recorded, {list(b)} here"
        parts = [(f"{path}[{key!r}]", a[key], b[key]) for key in a]
    elif hasattr(a, "_fields"):
        parts = [(f"{path}.{name}", getattr(a, name), getattr(b, name)) for name in a._fields]
    elif hasattr(a, "__dataclass_fields__"):
        names = a.__dataclass_fields__
        parts = [(f"{path}.{name}", getattr(a, name), getattr(b, name)) for name in names]
    elif isinstance(a, (tuple, list)):
        if len(a) != len(b):
            return f"{path}: {len(a)} values recorded, {len(b)} here"
        parts = [(f"{path}[{i}]", x, y) for i, (x, y) in enumerate(zip(a, b, strict=True))]
    else:
        return None if pack(a) == pack(b) else f"{path}: {a!r} recorded, {b!r} here"
    for where, x, y in parts:
        found = first_difference(x, y, where)
        if found is not None:
            return found.removeprefix(".")
    return None
