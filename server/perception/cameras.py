"""Cameras: which pictures are believed, which view is kept, and who stands in a line of sight."""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple, Self

import numpy as np

from ...config.load import Cell
from ...config.schema.sources import VisionSection
from ...config.schema.surroundings import CameraSection
from ...protocols.messages.perception import Sighting
from ..control.inputs import NO_PICTURE, Picture, ViewGoal
from ..control.proximity.capsules import Capsules
from ..control.proximity.distance import measured
from ..control.scene import Mount, Scene
from ..control.spatial import Array, Pose, pose_error, sizes
from ..events import Events
from ..refusals import Refused, Why
from .filters import (
    KnownCorners,
    KnownTarget,
    PictureRejection,
    SightingBounds,
    in_common,
    judge,
    nearest_to,
    pictured,
    with_seen,
)

# --- Vision tracker: which pictures are believed, which view is kept, and the age of both ---------
#
# A picture's tick names the telemetry that its sender had when it was exposed. The measured
# pose of the Wrist at that tick places the target, so that a late picture is no wrong one.
# Every picture that is not believed, and the view lost and found again, is an event; a row of
# equal doubts is one.
#
# A view is stored as a pose and as a picture, so that either law may keep it (`cameras.law`). A
# picture is kept by the corners that it has in common with what is seen, by their tags: where
# nothing of it is seen for as long as a picture may be old, it is lost, whatever else is seen.

Law = Literal["pose", "image"]


MODEL: Final = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 0.0]])
"""Corners (4, 3) of a tag of side 1, clockwise from the upper left [1]."""


def board_of(camera: CameraSection) -> dict[int, Array]:
    """Return the corners (4, 3) [m] of each tag of a camera's board, in the axes of its `tag`."""
    found = {}
    for each in camera.tags:
        T = Pose.from_xyz_rpy(each.T_board_tag.xyz, each.T_board_tag.rpy)
        found[each.tag] = each.size * MODEL @ T.R.T + T.p
    return found


@dataclass
class _Track:
    """One camera, and what is known of its target."""

    camera: CameraSection
    T_lens: Pose
    """Lens in the Wrist, in World or in Base."""
    board: dict[int, Array]
    """Corners (4, 3) of its tags, in the axes of the first [m]."""
    stored: Pose | None = None
    """The target in the Lens as it is to be; None before it was told or stored."""
    picture: dict[int, Array] = field(default_factory=dict)
    """The same as corners (4, 2) of its tags in normalised image coordinates [1]."""
    law: Law = "pose"
    """How the view is kept."""
    known: KnownTarget | None = None
    corners: dict[int, KnownCorners] = field(default_factory=dict)
    """Corners that were seen lately; none without a known target."""
    common: Picture = NO_PICTURE
    """What is known and stored, in the anchor; empty where that is too little to tell a view."""
    lost: bool = False
    """The target is known, and nothing of the picture that is to be kept is."""
    newest_tick: int = -1
    doubt: PictureRejection | None = None
    """Why the newest picture was not believed."""

    @property
    def carried(self) -> bool:
        """True for a camera on the Wrist."""
        return self.camera.on == "wrist"

    def tell(self, T_lens_target: Pose) -> None:
        """Store the view in which the target is at a pose, by the board of the cell."""
        self.stored = T_lens_target
        R, p = T_lens_target
        self.picture = _shown({tag: corners @ R.T + p for tag, corners in self.board.items()})
        self.compare()

    def compare(self) -> None:
        """Find what is seen of the stored picture."""
        self.common = in_common(self.corners, self.picture)

    def T_world_lens(self, at: "_Place") -> Pose:
        """Return the Lens in World."""
        match self.camera.on:
            case "wrist":
                return at.T_world_wrist @ self.T_lens
            case "base":
                return at.T_world_base @ self.T_lens
        return self.T_lens

    def T_anchor_lens(self, at: "_Place") -> Pose:
        """Return the Lens in the frame in which its target stands still: World, or the Wrist."""
        T = self.T_world_lens(at)
        return T if self.carried else at.T_world_wrist.inverse() @ T


class _Place(NamedTuple):
    """Where the arm was measured to be in one tick."""

    tick: int
    T_world_wrist: Pose
    T_world_base: Pose


class VisionTracker:
    """Tracks the targets of all cameras of a cell."""

    def __init__(
        self,
        vision: VisionSection,
        cameras: tuple[CameraSection, ...],
        period_s: float,
        events: Events,
    ) -> None:
        self._events = events
        self._timeout = round(vision.timeout_s / period_s)
        self._belief = SightingBounds(
            period_s,
            vision.least_quality,
            vision.jump_speed,
            vision.jump_angular_speed,
            *vision.jump_slack,
            vision.smoothing_s,
        )
        self._tracks = {c.name: _Track(c, _place(c), board_of(c), law=c.law) for c in cameras}
        self.watching = bool(cameras)
        """The cell has cameras."""
        self._places: deque[_Place] = deque(maxlen=self._timeout + 2)
        self._camera = vision.camera or next(iter(self._tracks), "")
        """Whose view is kept."""
        if vision.view is not None and self._camera in self._tracks:
            told = Pose.from_xyz_rpy(vision.view.xyz, vision.view.rpy)
            self._tracks[self._camera].tell(told)

    @classmethod
    def from_cell(cls, cell: Cell, events: Events) -> Self:
        """Return the tracker of a loaded cell."""
        c = cell.config
        return cls(c.sources.vision, c.cameras, c.timing.period_s, events)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras."""
        return tuple(self._tracks)

    @property
    def view(self) -> Pose | None:
        """The target in the Lens as last believed, None when stale."""
        track = self._tracks.get(self._camera)
        if track is None or track.known is None or not self._places:
            return None
        return track.T_anchor_lens(self._places[-1]).inverse() @ track.known.T_anchor_target

    @property
    def error(self) -> tuple[float, float] | None:
        """How far the Lens is from the stored view [m], [rad]; None when stale.

        Of a camera beside the arm: how far the target is.
        """
        view = self.view
        if view is None:
            return None
        track = self._tracks[self._camera]
        stored = track.stored
        if stored is None:
            return None
        if track.carried:
            view, stored = view.inverse(), stored.inverse()
        return sizes(pose_error(view, stored))

    @property
    def law(self) -> Law | None:
        """How the view is kept; None without a camera."""
        track = self._tracks.get(self._camera)
        return None if track is None else track.law

    @property
    def error_px(self) -> float | None:
        """How far the corners are from where the stored picture has them [px], rms; None: unknown.

        Of corners that are in both, between two pictures as the arm's own motion has them.
        """
        track = self._tracks.get(self._camera)
        if track is None or not len(track.common.points) or not self._places:
            return None
        lens = track.T_anchor_lens(self._places[-1])
        points = (track.common.points - lens.p) @ lens.R
        if points[:, 2].min() <= 0.0:
            return None
        off = (pictured(points) - track.common.wanted) * track.camera.focal
        return math.sqrt(float((off**2).sum()) / len(off))

    def lens(self) -> Mount | None:
        """Return where the Lens is of the camera whose view is kept."""
        track = self._tracks.get(self._camera)
        return None if track is None else Mount(track.camera.on, track.T_lens)

    def age(self, tick: int) -> int | None:
        """Return how many ticks old the newest picture is that was believed, None when stale."""
        track = self._tracks.get(self._camera)
        return None if track is None or track.known is None else tick - track.known.tick

    def remember(self, tick: int, T_world_wrist: Pose, T_world_base: Pose) -> None:
        """Store the measured poses of Wrist and Base of a tick, for pictures that belong to it."""
        self._places.append(_Place(tick, T_world_wrist, T_world_base))

    def take(self, sighting: Sighting, tick: int) -> None:
        """Take in what a camera saw. Raises `Refused` for a camera that the cell does not have."""
        track = self._tracks.get(sighting.camera)
        if track is None:
            known = ", ".join(self._tracks) or "none"
            raise Refused(Why.UNKNOWN_CAMERA, f"{sighting.camera!r} is none of {known}")
        if sighting.tick > tick:
            raise Refused(Why.FUTURE_PICTURE, f"tick {sighting.tick}, this is tick {tick}")
        believed = self._judge(track, sighting)
        if isinstance(believed, PictureRejection):
            if believed is not track.doubt:
                self._tell(track, "warning", "picture_rejected", believed, sighting.quality)
            track.doubt = believed
            return
        if track.known is None:
            self._tell(track, "info", "view_found", None, sighting.quality)
        track.known, track.doubt = believed, None
        self._learn(track, sighting, believed)

    def update(self, tick: int) -> None:
        """Forget targets that were seen too long ago: the source fades."""
        for track in self._tracks.values():
            if track.known is None:
                continue
            fresh = {t: c for t, c in track.corners.items() if tick - c.tick <= self._timeout}
            if len(fresh) < len(track.corners):
                track.corners = fresh
                track.compare()
            if tick - track.known.tick > self._timeout:
                track.known = None
                track.corners, track.common, track.lost = {}, NO_PICTURE, False
                self._tell(
                    track, "warning", "view_lost", track.doubt or PictureRejection.NO_PICTURE, None
                )
                continue
            lost = (
                track.law == "image" and track.stored is not None and not len(track.common.points)
            )
            if lost and not track.lost:
                self._tell(track, "warning", "view_lost", PictureRejection.NOTHING_STORED, None)
            elif track.lost and not lost:
                self._tell(track, "info", "view_found", None, None)
            track.lost = lost

    def store(
        self, camera: str | None, *, again: bool = False, law: Law | None = None
    ) -> dict[str, float]:
        """Keep the present view of a camera, or `again` the one that was stored for it before.

        By a `law`; None: by that of before. Returns it. Raises `Refused` where the camera sees
        nothing, or too few corners for a picture, or nothing was stored.
        """
        name = camera or self._camera
        track = self._tracks.get(name)
        if track is None:
            known = ", ".join(self._tracks) or "none"
            raise Refused(Why.UNKNOWN_CAMERA, f"{name!r} is none of {known}")
        if not again:
            if track.known is None or not self._places:
                raise Refused(Why.SENSOR_STALE, f"camera {name} sees no tag now")
            lens = track.T_anchor_lens(self._places[-1])
            stored = lens.inverse() @ track.known.T_anchor_target
            picture = _shown(
                {tag: (c.points - lens.p) @ lens.R for tag, c in track.corners.items()}
            )
        elif track.stored is None:
            raise Refused(Why.NOT_NOW, f"no view of camera {name} is stored yet")
        else:
            stored, picture = track.stored, track.picture
        law = law or track.law
        if law == "image" and not len(in_common(track.corners, picture).points) and not again:
            raise Refused(Why.SENSOR_STALE, f"camera {name} sees too few corners of a tag now")
        if law == "image" and not picture:
            raise Refused(Why.NOT_NOW, f"no picture of camera {name} is stored yet")
        track.stored, track.picture, track.law, self._camera = stored, picture, law, name
        track.compare()
        names = ("x", "y", "z", "roll", "pitch", "yaw")
        return dict(zip(names, stored.to_xyz_rpy(), strict=True))

    def require_view(self) -> None:
        """Raise `Refused` where there is nothing that the source could keep."""
        if not self._tracks:
            raise Refused(Why.UNKNOWN_CAMERA, "the cell has no camera")
        if self._tracks[self._camera].stored is None:
            raise Refused(Why.NOT_NOW, "no view is stored yet: ask operator/store_view first")

    def goal(self, T_world_base: Pose) -> ViewGoal | None:
        """Return where the view is to bring the arm, with Base where this tick's command has it.

        None without a view, or when it is stale.
        """
        track = self._tracks.get(self._camera)
        if track is None or track.known is None or track.stored is None:
            return None
        T_target, picture = track.known.T_anchor_target, NO_PICTURE
        if track.law == "image":
            picture = track.common
            if not len(picture.points):
                return None
        if track.carried:
            return ViewGoal(track.T_lens, T_target @ track.stored.inverse(), picture=picture)
        T_world_lens = track.T_lens
        if track.camera.on == "base":
            T_world_lens = T_world_base @ T_world_lens
        if len(picture.points):
            picture = picture._replace(points=(picture.points - T_target.p) @ T_target.R)
        return ViewGoal(T_target, T_world_lens @ track.stored, T_world_lens, picture)

    def _learn(self, track: _Track, sighting: Sighting, believed: KnownTarget) -> None:
        """Take in the corners of a picture that was believed."""
        if not sighting.seen:
            return
        place = next(p for p in self._places if p.tick == sighting.tick)
        T_anchor_lens = track.T_anchor_lens(place)
        poses = [Pose.from_xyz_rpy(p[:3], p[3:]) for p in sighting.poses]
        track.corners = with_seen(
            track.corners,
            sighting.tick,
            {tag: np.array(corners).reshape(4, 2) for tag, corners in sighting.seen},
            track.board,
            T_anchor_lens,
            nearest_to(T_anchor_lens.inverse() @ believed.T_anchor_target, poses),
            self._belief,
        )
        track.compare()

    def _judge(self, track: _Track, sighting: Sighting) -> KnownTarget | PictureRejection:
        if sighting.tick <= track.newest_tick:
            return PictureRejection.OUT_OF_ORDER
        track.newest_tick = sighting.tick
        place = next((p for p in self._places if p.tick == sighting.tick), None)
        if place is None:
            return PictureRejection.LATE
        T_anchor_lens = track.T_anchor_lens(place)
        poses = tuple(T_anchor_lens @ Pose.from_xyz_rpy(p[:3], p[3:]) for p in sighting.poses)
        return judge(
            track.known,
            sighting.tick,
            poses,
            sighting.errors_px,
            sighting.quality,
            self._belief,
        )

    def _tell(
        self,
        track: _Track,
        severity: str,
        name: str,
        doubt: PictureRejection | None,
        quality: float | None,
    ) -> None:
        if track.camera.name != self._camera:
            return
        tell = self._events.warning if severity == "warning" else self._events.info
        detail = f"camera {track.camera.name}" + (f": {doubt}" if doubt else "")
        tell(name, detail, camera=track.camera.name, reason=doubt, quality=quality)


def _shown(boards: dict[int, Array]) -> dict[int, Array]:
    """Return the picture of tags whose corners (4, 3) are before a Lens [m]."""
    return {tag: pictured(each) for tag, each in boards.items() if each[:, 2].min() > 0.0}


def _place(camera: CameraSection) -> Pose:
    return Pose.from_xyz_rpy(camera.place.xyz, camera.place.rpy)


# --- Sight lines: told when a link of the arm comes into one, and when it is free again -----------
#
# A sight line may be soft, or avoidance switched off; of two lines one may have to be given up.
# What sees along it then sees the arm, so operators are told which link hides what. A line
# begins at its camera: of one that the wrist carries, that arm's last links do not count.

EVERY = 5
"""Periods between two looks [1]."""

FREE = 0.005
"""A line that was lost is free again from this distance on [m]."""


class Hidden(NamedTuple):
    """The link that is nearest to a sight line."""

    link: str
    gap: float
    """Distance of the capsule around it from the line's own radius [m]; below zero inside."""


class SightLines:
    """Watches for the links of one arm in the sight lines of a cell."""

    def __init__(self, capsules: Capsules | None, events: Events) -> None:
        """Build it for an arm's capsules; without any nothing is watched."""
        self._capsules, self._events = capsules, events
        self._lost: set[str] = set()

    @property
    def lost(self) -> tuple[str, ...]:
        """Names of the lines that a link is in."""
        return tuple(sorted(self._lost))

    def update(self, scene: Scene, arm: int, q: Array, base: Pose | None) -> None:
        """Look at joint angles q (n,) [rad] of an `arm` of the cell, and tell each change.

        `base` is where its Base is; the scene is placed.
        """
        if self._capsules is None:
            return
        nearest = self._nearest(self._capsules, scene, arm, q, base)
        self._lost &= nearest.keys()
        for name, (link, gap) in nearest.items():
            if gap < 0.0 and name not in self._lost:
                self._lost.add(name)
                self._events.warning(
                    "sight_line_lost",
                    f"{link} is {-1e3 * gap:.0f} mm into {name}",
                    obstacle=name,
                    link=link,
                    gap_m=gap,
                )
            elif gap > FREE and name in self._lost:
                self._lost.discard(name)
                self._events.info("sight_line_free", name, obstacle=name)

    @staticmethod
    def _nearest(
        capsules: Capsules, scene: Scene, arm: int, q: Array, base: Pose | None
    ) -> dict[str, Hidden]:
        """Return the link that is nearest to each sight line, by the line's name."""
        rounds = scene.rounds
        lines = np.flatnonzero(rounds.line)
        if not len(lines):
            return {}
        ends, body = capsules.place(q[None], base).ends, capsules.body
        every, found = np.flatnonzero(capsules.movable), {}
        for line in lines.tolist():
            which = every
            if rounds.carrier[line] == arm:
                which = every[body[every] < body.max()]
            if not len(which):
                continue
            pairs = which, np.full(len(which), len(body) + line)
            gaps = measured(ends, pairs, scene.segments)[0]
            gaps = gaps - capsules.radius[which] - rounds.radius[line]
            i = int(gaps.argmin())
            found[scene.names[line]] = Hidden(capsules.links[which[i]], float(gaps[i]))
        return found
