"""Strategies for messages and bytes of the network, made from the messages' types.

A stranger holds no lease: he sends junk and news, on every key that the daemon hears.
"""

import math
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import ge, gt, le, lt
from typing import Annotated, Any, Union, get_args, get_origin

import msgpack
from annotated_types import Ge, Gt, Le, Len, Lt, MaxLen, MinLen
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from telerobot.config.load import Cell
from telerobot.config.schema.surroundings import NEEDED
from telerobot.protocols import topics as t
from telerobot.protocols.messages.messages import VERSION, Command, PathMotion
from telerobot.protocols.messages.perception import ContourNews
from telerobot.protocols.topics import Topic

Fields = dict[str, Any]

ODD = (0.0, -0.0, 1.0, -1.0, 5e-324, 1e-12, -1e-6, 0.3, math.pi, 1e6, -1e300, 1.7e308)
"""Numbers that have hurt somebody."""
WORDS = ("base", "carrier", "mrf", "wall", "floor", "ready", "start", "park", "x", "", "a\0😀")
KEPT = (t.KEEPALIVE, t.LEASE, t.RELEASE, t.PROTECTIVE_STOP)
"""The holder does not give his lease away by chance, and who may stop the arm does not."""
ASKED = tuple(topic for topic in (*t.COMMANDS, *t.REQUESTS) if topic not in KEPT[1:])
NEAR = 1.2
"""Obstacles come within this of World's origin along each axis [m]."""
THINGS = ("a", "b", "c", "d", "e", "f")
"""Names of obstacles that nobody put into the cell."""


# --- A message, by its type -----------------------------------------------------------------------


def fields_of(kind: type[BaseModel], words: Sequence[str] = WORDS) -> SearchStrategy[Fields]:
    """Return fields of a message, less a command's envelope, each inside its own bounds.

    What the message demands of several fields together may still be broken. `words` are names that
    mean something in the cell.
    """
    every = {
        name: of(field.annotation, words, *field.metadata)
        for name, field in kind.model_fields.items()
        if name not in Command.model_fields
    }
    needed = [name for name in every if kind.model_fields[name].is_required()]
    free = [name for name in every if name not in needed]
    given = st.lists(st.sampled_from(free), unique=True) if free else st.just([])
    drawn = given.flatmap(
        lambda names: st.fixed_dictionaries({name: every[name] for name in (*needed, *names)})
    )
    return drawn.flatmap(_FITTED[kind]) if kind in _FITTED else drawn


def of(annotation: Any, words: Sequence[str], *bounds: Any) -> SearchStrategy[Any]:
    """Return values of an annotated type, the odd ones more often than the usual."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return of(parts[0], words, *bounds, *parts[1:])
    bounds = tuple(
        b for bound in bounds for b in (bound.metadata if isinstance(bound, FieldInfo) else [bound])
    )
    if origin in (Union, types.UnionType):
        return st.one_of(*(of(part, words, *bounds) for part in parts))
    if origin in (dict, Mapping):
        return st.dictionaries(*(of(part, words) for part in parts), max_size=2)
    least, most = _lengths(bounds)
    if origin is tuple and parts[-1] is Ellipsis:
        counts = sorted({min(max(count, least), most) for count in (least, 1, 2, 6, 7, 8, most)})
        each = of(parts[0], words)
        return st.one_of(*(st.tuples(*n * [each]) for n in counts if n <= 8 or n == least)) | (
            each.map(lambda one: most * (one,))
        )
    if origin is tuple:
        return st.tuples(*(of(part, words) for part in parts))
    if annotation is float:
        return numbers(bounds)
    if annotation is int:
        return _from(int, Ge(-(2**63)), Lt(2**63), *bounds) | st.integers(0, 20)
    if annotation is str:
        return st.sampled_from([word[:most].ljust(least, "a") for word in (*words, most * "x")])
    if annotation is bytes:
        return st.binary(min_size=least, max_size=min(max(least, 32), most)) | st.just(bytes(most))
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return fields_of(annotation, words)
    return st.from_type(annotation)


def numbers(bounds: Sequence[Any]) -> SearchStrategy[float]:
    """Return numbers within bounds: odd ones, the bounds, any between, and small ones."""
    ends = [
        (holds, float(getattr(bound, holds.__name__)))
        for bound in bounds
        for kind, holds in {Ge: ge, Gt: gt, Le: le, Lt: lt}.items()
        if isinstance(bound, kind)
    ]
    odd = [x for x in (*ODD, *(end for _, end in ends)) if all(f(x, end) for f, end in ends)]
    some = _from(float, Ge(-1.7e308), Le(1.7e308), *bounds)
    low = max([-10.0, *(end for holds, end in ends if holds in (ge, gt))])
    high = min([10.0, *(end for holds, end in ends if holds in (le, lt))])
    return (st.sampled_from(odd) | some if odd else some) | _evenly(low, high)


def _from(kind: type, *bounds: Any) -> SearchStrategy[Any]:
    return st.from_type(Annotated[(kind, *bounds)])  # type: ignore[arg-type]  # no type as such


def _evenly(low: float, high: float) -> SearchStrategy[float]:
    """Return numbers that are as often in one part of a range as in another."""
    return st.integers(1, 999).map(lambda n: low + (high - low) * n / 1000)


def _lengths(bounds: Sequence[Any]) -> tuple[int, int]:
    least = max((b.min_length for b in bounds if isinstance(b, (Len, MinLen))), default=0)
    most = min((b.max_length or 64 for b in bounds if isinstance(b, (Len, MaxLen))), default=64)
    return least, most


def _with_cells(fields: Fields) -> SearchStrategy[Fields]:
    """Return news with as many cells as it says, and as it is: drawn apart, they never agree."""

    def whole(rows: int, columns: int, cell: bytes) -> Fields:
        return {**fields, "rows": rows, "columns": columns, "nearest_mm": rows * columns * cell}

    wide = st.integers(1, 20), st.integers(1, 40)
    return st.just(fields) | st.builds(whole, *wide, st.binary(min_size=2, max_size=2))


def _one_of_two(fields: Fields) -> SearchStrategy[Fields]:
    """Return a path as it is, and one of waypoints alone: drawn apart, its parts seldom agree."""
    parts = ("twists", "speeds", "durations_s")
    return st.just(fields) | st.just({k: v for k, v in fields.items() if k not in parts})


_FITTED: dict[type[BaseModel], Callable[[Fields], SearchStrategy[Fields]]] = {
    ContourNews: _with_cells,
    PathMotion: _one_of_two,
}


# --- What somebody sends --------------------------------------------------------------------------


@dataclass(frozen=True)
class Said:
    """One message of a stranger."""

    topic: Topic
    fields: Fields | bytes
    behind: int = 0
    """Its tick is so many before the one of now [1]."""
    edits: tuple[tuple[int, int, bytes], ...] = ()
    """Spoil its bytes: where, how many of them go, and what comes instead."""
    proof: bytes = b""

    def __repr__(self) -> str:
        edits = f" then {self.edits}" if self.edits else ""
        proof = f" proof {self.proof.hex()}" if self.proof else ""
        late = f" {self.behind} ticks behind" if self.behind else ""
        return f"{self.topic.key} {self.fields!r}{late}{edits}{proof}"

    def payload(self, tick: int) -> bytes:
        """Return it as it goes out in a tick."""
        fields = self.fields
        if not isinstance(fields, bytes):
            stamps = {"tick", "seen_tick"} & self.topic.message.model_fields.keys()
            seen = max(0, tick - self.behind)
            fields = msgpack.packb({"v": VERSION, **fields, **dict.fromkeys(stamps, seen)})
        data = bytearray(fields)
        for where, gone, instead in self.edits:
            at = where % (len(data) + 1)
            data[at : at + gone] = instead
        return bytes(data)


_EDIT = st.tuples(
    st.integers(0, 2**12 - 1), st.sampled_from((0, 1, 4, 2**12)), st.binary(max_size=8)
)
_LEAVES = st.sampled_from(
    (None, True, 0, -1, 2**63, 2**64 - 1, -(2**63), math.nan, math.inf, 1.7e308, 5e-324, 0.1)
) | st.sampled_from(("", "a\0☺", 300 * "a", b"", b"abc", bytes(300)))
_ANYTHING = st.recursive(
    _LEAVES | _LEAVES.map(lambda one: 70 * [one]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(("0", "1", "v")), inner)
    ),
    max_leaves=6,
)
_NESTED = st.builds(
    lambda opening, deep: opening * (deep // len(opening)) + b"\xc0",
    st.sampled_from((b"\x91", b"\x81\xa1a", b"\x92\xc0", b"\xdc\x00\x01")),
    st.sampled_from((6, 60, 800, 1500)),
)
"""Containers in containers, up to a payload's length: 1.5 kB may be 1,500 deep."""
_NUMBERS = st.sampled_from((0, 10**6, 2**63 - 1, 2**64 - 1)).map(lambda n: n.to_bytes(8, "big"))
_PROOFS = st.sampled_from((b"", b"\xc1", bytes(32), bytes(4096))) | st.builds(
    lambda epoch, seq, rest: bytes(7) + bytes([epoch]) + seq + 4 * rest,
    st.integers(0, 2), _NUMBERS, st.binary(min_size=4, max_size=4),
)  # fmt: skip
"""Stand for a proof of the lease: nothing, noise, or nearly one."""


def junk(topic: Topic, words: Sequence[str] = WORDS) -> SearchStrategy[Fields | bytes]:
    """Return what is no message of a topic, or nearly one."""
    lengths = (0, 1, 7, 200, topic.max_bytes, topic.max_bytes + 1)
    names = st.sampled_from((*topic.message.model_fields, "v", "more"))
    spoilt = st.dictionaries(names, _ANYTHING, max_size=2)
    return st.one_of(
        st.sampled_from(lengths).map(lambda n: n * b"\xc1"),
        st.binary(max_size=40),
        _ANYTHING.map(msgpack.packb),
        _NESTED,
        st.builds(
            lambda fields, wrong: {**fields, **wrong}, fields_of(topic.message, words), spoilt
        ),
    )


def said(topic: Topic, valid: SearchStrategy[Fields]) -> SearchStrategy[Said]:
    """Return messages of a topic: of five three `valid`, one of them spoilt, and one of junk."""
    edits = st.lists(_EDIT, min_size=1, max_size=3).map(tuple)
    whole = [st.builds(Said, st.just(topic), valid, _BEHIND, proof=_PROOFS) for _ in range(3)]
    edited = st.builds(Said, st.just(topic), valid, _BEHIND, edits, _PROOFS)
    odd = st.builds(Said, st.just(topic), junk(topic), _BEHIND, proof=_PROOFS)
    return st.one_of(*whole, edited, odd)


_BEHIND = st.sampled_from((0, 0, 0, 1, 5, 100, -5))


def words_of(cell: Cell) -> tuple[str, ...]:
    """Return names that mean something in a cell, and some that are odd."""
    config = cell.config
    things = (*config.mechanism.postures, *config.mechanism.payloads)
    return (*things, *(o.name for o in config.obstacles), *(c.name for c in config.cameras), *WORDS)


def of_strangers(cell: Cell) -> SearchStrategy[Said]:
    """Return what somebody says who holds no lease: news as often as all else."""
    words = words_of(cell)
    news = [said(topic, valid) for topic, valid in _news(cell, words).items()]
    asked = [said(topic, fields_of(topic.message, words)) for topic in ASKED]
    return st.booleans().flatmap(lambda told: st.one_of(news) if told else st.one_of(asked))


def _news(cell: Cell, words: Sequence[str]) -> dict[Topic, SearchStrategy[Fields]]:
    """Return news that may be believed, for each sensor that the cell listens to."""
    kinds = {topic: fields_of(topic.message, words) for topic in (t.OBSTACLE, t.FRAME_NEWS)}
    found = {t.OBSTACLE: _obstacles(cell) | kinds[t.OBSTACLE]}
    if cell.config.frames.moving:
        near = {"xyz": _place(0.2), "rpy": _place(0.2), "quality": st.just(1.0)}
        found[t.FRAME_NEWS] = _with(kinds[t.FRAME_NEWS], near) | kinds[t.FRAME_NEWS]
    if cell.config.cameras:
        pose = st.builds(lambda xyz, rpy: (*xyz, *rpy), _place(0.3), _place(0.5))
        shown = st.lists(st.tuples(pose, st.sampled_from((0.0, 0.2, 9e3))), max_size=2)
        tags = [each.tag for camera in cell.config.cameras for each in camera.tags]
        spot = _evenly(-1.0, 1.0)
        seen = st.lists(st.tuples(st.sampled_from((*tags, 8)), st.tuples(*[spot] * 8)), max_size=3)
        found[t.SIGHTING] = st.builds(
            lambda camera, quality, shown, seen: {
                "camera": camera, "quality": quality, "seen": seen,
                "poses": [each for each, _ in shown], "errors_px": [error for _, error in shown],
            },
            st.sampled_from([c.name for c in cell.config.cameras]), _evenly(0.0, 1.0), shown, seen,
        )  # fmt: skip
    return found


def _obstacles(cell: Cell) -> SearchStrategy[Fields]:
    width = st.sampled_from((1e-3, 0.021, 0.3, 0.5, 20.0))
    parts: dict[str, SearchStrategy[Any]] = {
        "name": st.sampled_from((*THINGS, *(o.name for o in cell.config.obstacles))),
        "stale": st.sampled_from(("keep", "keep", "grow", "stop")),
        "xyz": _place(NEAR), "to": _place(NEAR), "radius": st.sampled_from((0.0, 0.02, 0.1, 0.4)),
        "half_size": st.tuples(width, width, width), "remove": st.just(True),
    }  # fmt: skip
    needed = [("xyz", "stale"), ("remove",), *((*each, "stale") for each in NEEDED.values())]
    shapes = [{}, {}, *({"shape": st.just(shape)} for shape in NEEDED)]
    return st.one_of(*(
        st.fixed_dictionaries(shape | {key: parts[key] for key in ("name", *keys)})
        for shape, keys in zip(shapes, needed, strict=True)
    ))  # fmt: skip


def _with(
    drawn: SearchStrategy[Fields], given: dict[str, SearchStrategy[Any]]
) -> SearchStrategy[Fields]:
    return st.builds(lambda a, b: {**a, **b}, drawn, st.fixed_dictionaries(given))


def _place(far: float) -> SearchStrategy[tuple[float, float, float]]:
    x = _evenly(-far, far)
    return st.tuples(x, x, x)
