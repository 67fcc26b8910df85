"""`telerobot replay`: the control computation on a recorded run, every output compared."""

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...config.errors import printable
from ...config.load import Cell
from ...server.control.bodies.rates import ArmTick
from ...server.control.inputs import STILL, Inputs
from ...server.control.spatial import Array
from ...server.control.state import Memory
from ...server.control.tick import Control
from ...server.recorder import (
    MEMORY,
    TICK,
    TOLD,
    ReadTick,
    RecordedValueError,
    pack,
    read_row,
    told,
    unpack,
)
from ..host.progress import counted
from .run_file import Recorded, RecordError, read_about, read_cell, read_run

# --- Runs the pure tick on recorded inputs, and compares what comes out bit by bit ----------------
_ARRAYS = ("q", "dq", "command", "following_error", "twist")


class Replayed(NamedTuple):
    """One tick that was computed again."""

    record: ReadTick
    before: Memory
    after: Memory | None
    outputs: tuple[ArmTick, ...]
    raised: str | None  # error that the tick raised, in one line
    difference: str | None  # first output that differs from the record; None where none does
    stamp_ns: int = 0  # time of day of the recording [ns]

    @property
    def inputs(self) -> tuple[Inputs, ...]:
        """Inputs of the tick, of each arm."""
        return self.record.inputs


@dataclass
class Judgement:
    """Figures of a replay."""

    ticks: int = 0  # ticks that were computed again
    memories: int = 0  # memories that were compared, too
    skipped: int = 0  # ticks for which no memory was there to begin with
    first_s: float | None = None  # time of the first recorded tick, on the daemon's clock [s]
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
        memory: Memory | None = None
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
                memory = None
            if key is not None:
                if memory is not None:
                    judgement.memories += 1
                    if pack(memory) != key:
                        layout = first_difference(unpack(key), memory) or "another layout"
                        difference = f"memory: {layout}"
                memory, key = unpack(key), None
            if memory is None:
                judgement.skipped += 1
                continue
            replayed = self._tick(record, memory, difference)
            judgement.ticks += 1
            if judgement.difference is None and replayed.difference is not None:
                judgement.difference = (
                    f"tick {record.tick}, {record.time_s:.3f} s: {replayed.difference}"
                )
            memory = replayed.after
            yield replayed._replace(stamp_ns=message.stamp_ns)

    def _tick(self, record: ReadTick, memory: Memory, difference: str | None) -> Replayed:
        try:
            after, outputs = self._control.tick(memory, record.inputs)
        except Exception as error:  # noqa: BLE001  what the daemon's tick raised, this one raises
            words = f"{type(error).__name__}: {error}"
            if difference is None and record.told:
                difference = f"raised here: {words}"
            return Replayed(record, memory, None, (), words, difference)
        return Replayed(
            record, memory, after, outputs, None, difference or _of_outputs(record, outputs)
        )


def _of_outputs(record: ReadTick, outputs: tuple[ArmTick, ...]) -> str | None:
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


# --- One tick in words: what every stage did, in the order of the tick's page ---------------------
SMALL = 1e-12  # twists below this are not told [m/s, rad/s]


def explain(cell: Cell, tick: Replayed) -> str:
    """Return what one replayed tick looked at and decided, for every arm, as lines."""
    record = tick.record
    lines = [f"tick {record.tick}, {record.time_s:.3f} s, mode {record.mode}"]
    first = 0
    for i, part in enumerate(cell.parts):
        if len(cell.parts) > 1:
            lines.append(f"{part.config.mechanism.name}:")
        names = [joint.name for joint in part.robot.joints]
        output = tick.outputs[i] if tick.outputs else None
        before = tick.before.commanded.motion.dq[first : first + len(names)]
        first += len(names)
        lines += _arm(names, record.inputs[i], before, output, tick.after)
    if tick.raised is not None:
        lines.append(f"it raised          {tick.raised}")
    if tick.difference is not None:
        lines.append(f"not as recorded    {tick.difference}")
    return "\n".join(lines)


def _arm(
    joints: Sequence[str],
    inputs: Inputs,
    dq_before: Array,
    output: ArmTick | None,
    after: Memory | None,
) -> Iterator[str]:
    yield _line("intent", inputs.intent.name.lower())
    yield _line("asked for", ", ".join(_asked(inputs)) or "nothing")
    yield _line("joints measured", _numbers(inputs.q_measured))
    wrench = inputs.wrench_sensor
    yield _line("sensor reads", "nothing fresh" if wrench is None else _numbers(wrench))
    if output is None or after is None:
        return
    yield _line("joints commanded", _numbers(output.q))
    yield _line("following error", _numbers(output.error))
    if output.wrench is not None:
        yield _line("wrench at the MRF", _numbers(output.wrench))
    yield "1 sources, 2 sum"
    for name, twist in output.twists.items():
        if float(np.abs(twist).max()) > SMALL:
            gain = output.task.gains.get(name)
            told = "" if gain is None else f", gain {_numbers(gain)}"
            yield _line(f"  {name}", _numbers(twist) + told)
    yield _line("  sum", _numbers(output.twist))
    if output.task.position.progress is not None:
        path = output.task.position.progress
        yield _line(
            "  path", f"leg {path.leg + 1} of {path.legs}, {path.part:.1%}, pace {path.pace:.3f}"
        )
    yield "3 resolve"
    yield _line("  least singular value", f"{output.found.sigma_min:.4g}")
    motion = output.found.self_motion
    if float(np.abs(motion.dq).max()) > SMALL:
        of = ", ".join(f"{name} {norm:.3g}" for name, norm in motion.norms.items() if norm > SMALL)
        yield _line("  self-motion", f"{_numbers(motion.dq)} ({of})")
    yield "4 allow"
    yield _line("  granted", f"{output.granted:.4f} of the motion asked for")
    yield _line("  limited by", ", ".join(output.limits) or "nothing")
    for gap in output.gaps[:5]:
        acts = ", its barrier acts" if gap.active else ""
        yield _line("  gap", f"{gap.link} - {gap.other}: {1e3 * gap.gap:.2f} mm{acts}")
    yield "5 limit"
    changed = output.dq - dq_before
    fastest = int(np.abs(changed).argmax())
    yield _line("  joint rates", _numbers(output.dq))
    yield _line("  greatest change", f"{joints[fastest]}: {changed[fastest]:+.4g} rad/s")
    took = "the stop verified before goes on" if "verified_stop" in output.limits else "a new one"
    yield _line("  verified stop", f"{took}, {after.commanded.stop.to_go_s:.3f} s long")
    if output.stop_worsened:
        yield _line("  worsened", "no stop keeps every clearance: the least bad one was taken")
    yield "6 gate, 7 actuate"
    yield _line("  refusal", output.refusal or "none")
    yield _line("  sent", _numbers(output.command))
    words = {
        "at rest": output.at_rest,
        "at its goal": output.at_goal,
        "bleeding off contact": output.bleeding,
    }
    yield _line("  state", ", ".join(word for word, so in words.items() if so) or "moving")


def _asked(inputs: Inputs) -> Iterator[str]:
    if inputs.stick is not None:
        yield f"stick {_numbers(inputs.stick.twist)}"
    if inputs.jog is not None:
        yield f"jog {_numbers(inputs.jog)}"
    if inputs.goal is not None:
        yield f"{type(inputs.goal).__name__} {inputs.goal.serial}"
    if inputs.paused:
        yield "paused"
    if inputs.posture is not None:
        yield f"posture {_numbers(inputs.posture)}"
    if inputs.view is not None:
        yield "view"
    if np.any(inputs.wrench_desired):
        yield f"wrench {_numbers(inputs.wrench_desired)}"
    if inputs.drive != STILL:
        yield f"insertion {inputs.drive}"
    if inputs.settings.speed_factor != 1.0:
        yield f"speed factor {inputs.settings.speed_factor:g}"


def _numbers(values: Array) -> str:
    return "[" + " ".join(f"{value:.5g}" for value in values.tolist()) + "]"


def _line(name: str, words: str) -> str:
    return f"{name:<22} {words}"


# --- `telerobot replay RUN.mcap`: the pure tick on recorded inputs, compared bit by bit -----------
def run(args: argparse.Namespace) -> int:
    """Replay; return 0 where every output is the recorded one, else 1.

    Raises `RecordError`, `OSError`.
    """
    path, until = args.file, args.until
    cell, version = read_cell(path), read_about(path).get("version")
    ours = metadata.version("telerobot")
    if version not in (None, ours):
        print(
            f"telerobot: recorded by version {printable(version)}, replayed by {ours}",
            file=sys.stderr,
        )
    replay = Replay(path, cell)
    judgement, last = replay.judgement, None
    end_s = None if until is None else until + _origin_s(path, until)
    for tick in counted(replay.run(), "replayed", "ticks"):
        if end_s is not None and last is not None and tick.record.time_s > end_s:
            break
        last = tick
    if last is None:
        raise RecordError(f"{path}: holds no memory that a tick began with: nothing to replay")
    if args.explain:
        print(*map(printable, explain(cell, last).splitlines()), sep="\n")
    same = judgement.difference is None
    first, skipped = judgement.first_s or 0.0, ""
    if judgement.skipped:
        skipped = f", {judgement.skipped} skipped without a memory to begin with"
    print(
        f"{judgement.ticks} ticks to {last.record.time_s - first:.2f} s and "
        f"{judgement.memories} memories replayed{skipped}: "
        + ("all as recorded, to the last bit" if same else "NOT as recorded")
    )
    if not same:
        print(f"first difference: {printable(judgement.difference)}")
    return 0 if same else 1


def _origin_s(path: Path, until: float) -> float:
    """Return the time of the first recorded tick, or of the last one for a time below 0 [s]."""
    times = (read_row(message.data).time_s for message in read_run(path, (TICK,)))
    if until >= 0.0:
        return next(times, 0.0)
    newest = 0.0
    for time_s in times:
        newest = time_s
    return newest
