"""Flight recorder: the last seconds of ticks to the last bit, and the black box at every fault."""

import contextlib
import dataclasses
import enum
import io
import os
import struct
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from threading import Thread
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import msgpack
import numpy as np
from mcap.writer import Writer
from numpy.lib.stride_tricks import as_strided

from .control.bodies.rates import ArmTick
from .control.inputs import Inputs, Settings
from .control.state import Memory
from .control.stop.trajectory import PositionPlanner, Profile
from .events import Events
from .mode import Mode

# --- MCAP around rows that are bytes already: a file is joined, not encoded row by row ------------

TICK: Final = "tick"
"""Channel of the ticks' inputs and outputs; MessagePack, see `log.TickRecord`."""
MEMORY: Final = "memory"
"""Channel of memories that a tick began with; MessagePack, see `values`."""
CELL: Final = "cell.json"
"""Name of the attachment that holds the cell (`config.bundle`)."""
ABOUT: Final = "run"
"""Name of the metadata that says what was run."""

_MESSAGE: Final = struct.Struct("<BQHIQQ")
_MESSAGE_OPCODE: Final = 0x05
# The data section ends without a checksum, and there is no summary.
_END: Final = struct.pack("<BQI", 0x0F, 4, 0) + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0)
_MAGIC: Final = b"\x89MCAP0\r\n"


class Stamped(NamedTuple):
    """A message of a channel."""

    channel: str
    stamp_ns: int
    data: bytes


def joined(cell: str, about: Mapping[str, str], messages: Iterable[Stamped]) -> bytes:
    """Return an MCAP file: a cell as text, facts about the run, and messages of ticks."""
    head = io.BytesIO()
    writer = Writer(head, use_chunking=False)
    writer.start(profile="", library="telerobot")
    channels = {
        name: writer.register_channel(name, "msgpack", 0, {"telerobot": "1"})
        for name in (TICK, MEMORY)
    }
    writer.add_attachment(0, 0, CELL, "application/json", cell.encode())
    writer.add_metadata(ABOUT, dict(about))
    parts = [head.getvalue()]
    for sequence, (name, stamp, data) in enumerate(messages):
        head_of = _MESSAGE.pack(
            _MESSAGE_OPCODE, 22 + len(data), channels[name], sequence, stamp, stamp
        )
        parts += (head_of, data)
    return b"".join((*parts, _END, _MAGIC))


# --- Values of the control computation as bytes, and back, to the last bit ------------------------
#
# Any dataclass, named tuple or enum of `server/control` is written as its name and its fields,
# an array with its memory layout, since a sum may round otherwise in another one. Reading makes
# objects of those classes and of no others, and runs no code of a file.

CONTROL: Final = f"{__package__}.control"

_PLAIN: Final = frozenset({type(None), bool, int, float, str, bytes})
_TUPLE, _LIST, _MAP, _PROXY, _STRUCT, _ENUM, _ARRAY, _SCALAR, _PROFILE = range(9)

_FLOAT: Final = np.dtype("<f8")

Lower = Callable[[Any], Any]


class RecordedValueError(ValueError):
    """Bytes that are no recorded value, or were recorded by another version."""


def pack(value: object) -> bytes:
    """Return a value as bytes. Raises `TypeError` for one that cannot be recorded."""
    packed: bytes = msgpack.packb(_lowered(value))
    return packed


def unpack(data: bytes) -> Any:
    """Return the value of some bytes. Raises `RecordedValueError`."""
    try:
        return _raised(msgpack.unpackb(data, use_list=False, max_ext_len=0))
    except RecordedValueError:
        raise
    except (ValueError, TypeError, KeyError, IndexError, msgpack.UnpackException) as error:
        raise RecordedValueError(f"no recorded value: {error}") from None


# --- writing -------------------------------------------------------------------------------------


def _lowered(value: Any) -> Any:
    kind: Any = type(value)
    return value if kind in _PLAIN else _lower(kind)(value)


def _array(value: "np.ndarray[Any, Any]") -> tuple[object, ...]:
    dtype, flags = value.dtype, value.flags
    if flags.c_contiguous:
        return (_ARRAY, "<f8" if dtype is _FLOAT else dtype.str, value.shape, value.tobytes())
    if flags.f_contiguous:
        return (_ARRAY, value.dtype.str, value.shape, value.tobytes("F"), "F")
    return (_ARRAY, value.dtype.str, value.shape, value.tobytes(), value.strides)


@cache
def _lower(kind: Any) -> Lower:
    """Return what takes values of a class apart. Raises `TypeError` for a foreign one."""
    special: dict[type, Lower] = {
        tuple: lambda v: (_TUPLE, *map(_lowered, v)),
        list: lambda v: (_LIST, *map(_lowered, v)),
        dict: lambda v: (_MAP, *((_lowered(k), _lowered(x)) for k, x in v.items())),
        MappingProxyType: lambda v: (_PROXY, _lowered(dict(v))),
        np.ndarray: _array,
        Profile: lambda v: (_PROFILE, *map(_lowered, (*v.plan, v.elapsed_s))),
    }
    if kind in special:
        return special[kind]
    if issubclass(kind, np.generic):
        return lambda v: (_SCALAR, v.dtype.str, v.tobytes())
    if issubclass(kind, enum.StrEnum) and not kind.__module__.startswith(CONTROL):
        return lambda v: v.value  # a name from a message: it equals its text
    name = _name_of(kind)
    if issubclass(kind, enum.Enum):
        return lambda v: (_ENUM, name, v.name)
    get, _ = fields_of(kind)
    return lambda v: (_STRUCT, name, *map(_lowered, get(v)))


def fields_of(kind: type) -> tuple[Callable[[Any], tuple[Any, ...]], int]:
    """Return what takes the fields of a value of a class, and how many there are."""
    names = _fields(kind)
    return _getter(names), len(names)


def struct_head(kind: type) -> bytes:
    """Return what stands before the fields of a value of a class, in its bytes."""
    _, count = fields_of(kind)
    packer = msgpack.Packer()
    parts: list[bytes] = [
        packer.pack_array_header(2 + count), msgpack.packb(_STRUCT), msgpack.packb(_name_of(kind))
    ]  # fmt: skip
    return b"".join(parts)


def _getter(fields: tuple[str, ...]) -> Callable[[Any], tuple[Any, ...]]:
    if len(fields) == 1:
        only = attrgetter(fields[0])
        return lambda v: (only(v),)
    return attrgetter(*fields) if fields else lambda _: ()


def _name_of(kind: type) -> str:
    module = kind.__module__
    if not module.startswith(f"{CONTROL}.") or _fields(kind) is None:
        raise TypeError(f"a {kind.__module__}.{kind.__qualname__} cannot be recorded")
    return f"{module.removeprefix(f'{CONTROL}.')}:{kind.__qualname__}"


def _fields(kind: type) -> Any:
    """Return the names of a class's fields; None for a class that has none by name."""
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind))
    if issubclass(kind, enum.Enum):
        return ()
    return getattr(kind, "_fields", None)


# --- reading -------------------------------------------------------------------------------------


def _raised(value: Any) -> Any:
    if type(value) is not tuple:
        return value
    tag, *rest = value
    match tag:
        case 0:  # _TUPLE
            return tuple(map(_raised, rest))
        case 1:  # _LIST
            return list(map(_raised, rest))
        case 2:  # _MAP
            return {_raised(k): _raised(v) for k, v in rest}
        case 3:  # _PROXY
            return MappingProxyType(_raised(rest[0]))
        case 4:  # _STRUCT
            return _struct(rest[0], [_raised(v) for v in rest[1:]])
        case 5:  # _ENUM
            return _class(rest[0])[rest[1]]
        case 6:  # _ARRAY
            return _array_of(*rest)
        case 7:  # _SCALAR
            return np.frombuffer(rest[1], np.dtype(rest[0]))[0]
        case 8:  # _PROFILE
            start, target, bounds, straight, elapsed_s = map(_raised, rest)
            planner = PositionPlanner(len(target), straight)
            return planner.plan(start, target, bounds).advanced(elapsed_s)
    raise RecordedValueError(f"no recorded value: tag {tag!r}")


def _struct(name: str, values: list[Any]) -> Any:
    kind: Any = _class(name)
    fields = _fields(kind)
    if len(fields) != len(values):
        raise RecordedValueError(
            f"{name} has {len(fields)} fields here and {len(values)} in the recording: "
            "another version of telerobot recorded it"
        )
    if dataclasses.is_dataclass(kind):
        new: Any = object.__new__
        made = new(kind)
        made.__dict__.update(zip(fields, values, strict=True))
        return made
    return kind(*values)


@cache
def _class(name: str) -> Any:
    """Return a class of the control computation by its name; no other is ever made."""
    module, _, qualname = name.partition(":")
    parts = module.split(".")
    try:
        if not all(part.isidentifier() for part in (*parts, qualname)):
            raise AttributeError
        kind = getattr(import_module(f"{CONTROL}.{module}"), qualname)
    except (ImportError, AttributeError):
        kind = None
    if not isinstance(kind, type) or kind.__module__ != f"{CONTROL}.{module}":
        raise RecordedValueError(f"{name}: no class of this version's control computation")
    if _fields(kind) is None:
        raise RecordedValueError(f"{name}: holds no fields")
    return kind


def _array_of(
    dtype: str, shape: tuple[int, ...], data: bytes, layout: str | tuple[int, ...] = "C"
) -> "np.ndarray[Any, Any]":
    flat = np.frombuffer(data, np.dtype(dtype))
    if isinstance(layout, str):
        return flat.reshape(shape, order="F" if layout == "F" else "C").copy(order="K")
    if min(layout) < 0 or flat.size == 0:
        return flat.reshape(shape).copy()
    span = sum((n - 1) * s for n, s in zip(shape, layout, strict=True)) // flat.itemsize + 1
    if span > 64 * flat.size or any(s % flat.itemsize for s in layout):
        return flat.reshape(shape).copy()
    found = as_strided(np.zeros(span, flat.dtype), shape, layout)
    found[...] = flat.reshape(shape)
    return found


# --- Inputs of a tick as bytes, quickly: what is the same object as a tick ago is not packed anew


class FieldsPacker:
    """Packs values of one class field by field, and keeps what the last one's fields packed to.

    Fields of the classes `within` are packed in the same way, each by its own.
    """

    def __init__(self, kind: type, within: "Mapping[type, FieldsPacker]" = MappingProxyType({})):
        # Each call of `packb` takes memory for a buffer, and gives it back.
        self._pack: Callable[[Any], bytes] = msgpack.Packer().pack
        self._get, count = fields_of(kind)
        self._head, self._within = struct_head(kind), within
        self._last: list[Any] = [self] * count
        self._packed = [b""] * count

    def pack(self, value: object) -> bytes:
        """Return the same bytes as `pack`. Raises `TypeError` for what cannot be recorded."""
        last, packed = self._last, self._packed
        for i, field in enumerate(self._get(value)):
            if field is last[i]:
                continue
            kind: Any = type(field)
            if kind in self._within:
                packed[i] = self._within[kind].pack(field)
            else:
                packed[i] = self._pack(field if kind in _PLAIN else _lower(kind)(field))
            last[i] = field
        return self._head + b"".join(packed)


def inputs_packer() -> FieldsPacker:
    """Return what packs the inputs of one arm, tick after tick."""
    return FieldsPacker(Inputs, {Settings: FieldsPacker(Settings)})


# --- The last seconds of ticks: what went in as bytes, what came out, and now and then the memory
#
# A tick's row holds bytes only, so that it costs the garbage collector nothing. Memories follow
# from each other: one of them is kept every `KEY_EVERY` ticks, and wherever one did not come
# from the tick before. From there on, inputs alone tell how it went on (`replay`).

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
    memory: Memory | None
    """What the tick began with, where that is kept."""


class ReadTick(NamedTuple):
    """One tick as it is read again."""

    number: int
    """Rows before it, since the daemon began."""
    tick: int
    time_s: float
    mode: str
    goes_on: bool
    """It began with the memory that the tick before ended with."""
    inputs: tuple[Inputs, ...]
    told: tuple[Any, ...]
    """Outputs of each arm, as `told` takes them; none where the tick raised."""


def told(output: ArmTick) -> tuple[Any, ...]:
    """Return what is kept of an output: all that is sent, and what decided it, to the last bit."""
    return (
        output.q.tobytes(),
        output.dq.tobytes(),
        output.command.tobytes(),
        output.error.tobytes(),
        output.twist.tobytes(),
        output.granted,
        output.found.sigma_min,
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
    """Makes the rows of one cell's ticks, and holds the newest for a black box."""

    def __init__(self, period_s: float, arms: int, wall_ns: Callable[[], int] = time.time_ns):
        """Build it for so many arms; `wall_ns` tells the wall clock's time [ns]."""
        self.rows: deque[KeptTick] = deque(maxlen=max(KEY_EVERY, round(SECONDS / period_s)))
        self.taps: list[Callable[[KeptTick], None]] = []
        """Called with every row; without any, rows are not made."""
        self._wall_ns = wall_ns
        self._packers = [inputs_packer() for _ in range(arms)]
        self._pack: Callable[[Any], bytes] = msgpack.Packer().pack
        self.lost = 0
        """Ticks that could not be recorded [1]."""
        self._count = 0
        self._next: Memory | None = None

    def keep(
        self,
        tick: int,
        time_s: float,
        mode: Mode,
        memory: Memory,
        inputs: Sequence[Inputs],
        after: Memory | None,
        outputs: Sequence[ArmTick],
    ) -> None:
        """Keep one tick: what it began with, looked at of each arm, ended with and decided.

        A tick that raised has neither `after` nor `outputs`.
        """
        if not self.taps:
            return
        goes_on, self._next = memory is self._next, after
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
        key = memory if not goes_on or tick % KEY_EVERY == 0 else None
        row = KeptTick(tick, self._wall_ns(), data, key)
        for tap in self.taps:
            tap(row)


# --- The black box: the log's last seconds as a file, at every fault and verified stop ------------
#
# Written by a thread of its own, which holds the interpreter for a fraction of a millisecond at
# a time. The tick looks only whether it is done.

MOST: Final = 10
"""Files of each kind, of faults and of stops, that are kept of one cell, the newest [1]."""

YIELD_S: Final = 2e-3
"""Between two memories the writer sleeps, so that a tick need not wait for it [s]."""


@dataclass(frozen=True)
class Written:
    """The end of a file's writing."""

    path: Path
    failure: str | None
    """Why it could not be written, in one line; None where it was."""


class BlackBox:
    """Writes the files of one cell into a folder, one at a time."""

    def __init__(
        self,
        folder: Path,
        cell_name: str,
        cell: str,
        about: dict[str, str],
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Build it; `cell` is the cell as text, `about` says what is run."""
        self._folder, self._name, self._cell, self._about = folder, cell_name, cell, about
        self._wall_ns = wall_ns
        self._done: deque[Written] = deque()
        self._thread: Thread | None = None

    @property
    def busy(self) -> bool:
        """True while a file is being written."""
        return self._thread is not None and self._thread.is_alive()

    def write(self, kind: str, rows: Sequence[KeptTick]) -> bool:
        """Begin to write rows to a file; return False where one is still being written."""
        if self.busy or not rows:
            return False
        at = datetime.fromtimestamp(self._wall_ns() / 1e9, UTC).strftime("%Y%m%dT%H%M%S%fZ")
        path = self._folder / f"blackbox_{self._name}_{at}_{kind}.mcap"
        about = {**self._about, "kind": kind}
        self._thread = Thread(
            target=self._write, args=(path, about, rows), name="black box", daemon=True
        )
        self._thread.start()
        return True

    def poll(self) -> Written | None:
        """Return a file whose writing came to an end since the last call, if any."""
        return self._done.popleft() if self._done else None

    def close(self) -> None:
        """Wait for the file that is being written."""
        if self._thread is not None:
            self._thread.join()

    def _write(self, path: Path, about: dict[str, str], rows: Sequence[KeptTick]) -> None:
        failure = None
        part = path.with_suffix(".part")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            part.write_bytes(joined(self._cell, about, _messages(rows)))
            os.replace(part, path)
            self._drop_old(path)
        except (OSError, TypeError) as error:
            failure = " ".join(str(error).split())
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
        self._done.append(Written(path, failure))

    def _drop_old(self, newest: Path) -> None:
        kind = newest.stem.rpartition("_")[2]
        every = sorted(self._folder.glob(f"blackbox_{self._name}_????????T*Z_{kind}.mcap"))
        for old in every[:-MOST]:
            old.unlink(missing_ok=True)


def _messages(rows: Sequence[KeptTick]) -> Iterator[Stamped]:
    for row in rows:
        if row.memory is not None:
            yield Stamped(MEMORY, row.stamp_ns, pack(row.memory))
            time.sleep(YIELD_S)
        yield Stamped(TICK, row.stamp_ns, row.data)


# --- Flight recorder of the cycle: it keeps every tick, and acts when the mode changes ------------

AFTER: Final = 50
"""Ticks that a black box has after the fault [1]."""


class Flight:
    """The log of a cell's ticks, and the black box that it fills; `box` None: none is written."""

    def __init__(self, log: FlightLog, events: Events, box: BlackBox | None = None) -> None:
        self.log, self._events, self._box = log, events, box
        if box is not None:
            log.taps.append(log.rows.append)
        self._mode = Mode.BOOT
        self._due: tuple[str, int] | None = None
        """Kind and tick of the file that is to be written."""

    def end(self, tick: int, mode: Mode) -> None:
        """Take in the mode at the end of a period; write the black box where that says so."""
        before, self._mode = self._mode, mode
        box = self._box
        if box is None:
            return
        if mode is Mode.FAULT and before is not Mode.FAULT:
            self._due = "fault", tick + AFTER
        elif before is Mode.STOPPING and mode is not Mode.STOPPING and self._due is None:
            self._due = "stop", tick
        if self._due is not None and tick >= self._due[1]:
            self._write(box, self._due[0])
        written = box.poll()
        if written is None:
            return
        if written.failure is None:
            self._events.info("black_box", str(written.path), path=str(written.path))
        else:
            self._events.warning("black_box_failed", f"{written.path}: {written.failure}")

    def close(self) -> None:
        """Write what is still due, and wait for it."""
        box = self._box
        if box is None:
            return
        box.close()
        if self._due is not None:
            self._write(box, self._due[0])
            box.close()

    def _write(self, box: BlackBox, kind: str) -> None:
        if box.write(kind, tuple(self.log.rows)):
            self._due = None
