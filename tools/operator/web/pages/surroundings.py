"""Surroundings that a page is shown: obstacles, contour, scans and pictures, as sensors tell."""

import base64
import json
import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, NamedTuple

from .....protocols import topics as t
from .....protocols.codec import CodecError, decode_as
from .....protocols.messages.perception import (
    NOTHING,
    CameraPicture,
    ContourNews,
    ObstacleNews,
    ScanPoints,
)
from .....protocols.messages.rig import RigTruth
from ....client.line import Buffer, MessageCarrier
from ...words.passage import passage_words

TRUTH_S: Final = 1 / 20
"""Pages are told the rig's truth at most this often [s]."""


class Told(NamedTuple):
    """A message for all pages, as JSON."""

    kind: str
    """Newer messages of a kind make older ones needless; empty: each one counts."""
    text: str


class WorldNews:
    """Reads what sensors and the rig tell; asks for what is for eyes while somebody looks."""

    def __init__(self, session: MessageCarrier) -> None:
        self._session = session
        self._truths = session.subscribe(t.RIG_TRUTH, 1)
        self._obstacles = session.subscribe(t.OBSTACLE, 128)
        self._contours = session.subscribe(t.CONTOUR, 1)
        self._looked_at: dict[t.Topic, Buffer] = {}
        self._truth_s = float("-inf")

    def turn(self, now_s: float, looked_at: bool) -> Iterator[Told]:
        """Yield what is new; `looked_at` says whether any page is open."""
        if looked_at and not self._looked_at:
            self._looked_at = {
                topic: self._session.subscribe(topic, topic.unread) for topic in FOR_EYES
            }
        elif not looked_at:
            for inbox in self._looked_at.values():
                inbox.close()
            self._looked_at = {}
        if now_s - self._truth_s >= TRUTH_S:
            self._truth_s = now_s
            yield from _read(self._truths, t.RIG_TRUTH, told_truth)
        yield from _read(self._obstacles, t.OBSTACLE, told_obstacle)
        yield from _read(self._contours, t.CONTOUR, told_contour)
        for topic, inbox in self._looked_at.items():
            yield from _read(inbox, topic, FOR_EYES[topic])


def _read(inbox: Buffer, topic: t.Topic, tell: Callable[[Any], Told]) -> Iterator[Told]:
    for payload in inbox.take():
        try:
            message = decode_as(topic.message, payload, topic.max_bytes)
        except CodecError:
            continue  # of another version, or junk: the page does without
        yield tell(message)


def told_truth(truth: RigTruth) -> Told:
    """Return the rig's truth as a page is told it."""
    return Told("truth", f'{{"type":"truth","truth":{truth.model_dump_json()}}}')


def told_obstacle(news: ObstacleNews) -> Told:
    """Return news of an obstacle as a page is told it."""
    return Told("", f'{{"type":"obstacle","obstacle":{news.model_dump_json()}}}')


def told_contour(news: ContourNews) -> Told:
    """Return a contour as a page is told it, with words for the passage."""
    cells = struct.unpack(f"<{news.rows * news.columns}H", news.nearest_mm)
    contour = {
        **news.model_dump(include={"tick", "rows", "columns", "cell", "phase", "most_speed"}),
        "nearest_mm": [None if each == NOTHING else each for each in cells],
        "words": passage_words(news.phase, news.reason),
    }
    return Told("contour", json.dumps({"type": "contour", "contour": contour}))


def told_picture(picture: CameraPicture) -> Told:
    """Return a picture as a page is told it."""
    told = {"camera": picture.camera, "tick": picture.tick}
    jpeg = base64.b64encode(picture.jpeg).decode()
    text = json.dumps({"type": "picture", "picture": {**told, "jpeg": jpeg}})
    return Told(f"picture {picture.camera}", text)


def told_scan(scan: ScanPoints) -> Told:
    """Return a scan as a page is told it: its points as they came, in base 64."""
    points = base64.b64encode(scan.points_mm).decode()
    text = json.dumps({"type": "scan", "scan": {"tick": scan.tick, "points_mm": points}})
    return Told("scan", text)


FOR_EYES: Final[Mapping[t.Topic, Callable[[Any], Told]]] = {
    t.PICTURE: told_picture,
    t.SCAN: told_scan,
}
"""What is made only while somebody looks, and how a page is told it."""
