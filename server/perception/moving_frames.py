"""The frames that move: which news of them is believed, how old it is, and where they are now.

News names the telemetry tick in which it was measured, so that its lateness is made up for. Every
piece that is not believed, and a frame lost and found again, is an event; a row of equal doubts is
one.
"""

import math
from dataclasses import dataclass

import numpy as np

from ...config.load import Cell
from ...config.schema.moving import MovingFrame
from ...protocols.messages.moving import FrameNews
from ..control.frame_tree import Body, Moved
from ..control.spatial import Pose, rotate_twist, rotation_exp
from ..refusals import Refused, Why
from ..runtime.events import Events
from .filters.follower import Follower, FollowerState
from .filters.frame_tracking import (
    NewsRejection,
    PlausibleMotion,
    RejectedNews,
    Track,
    update_track,
)

LEAD_PERIODS = 1.0
"""The pose that a tick starts from is reached at the next SYNC [periods]."""


@dataclass
class _Watched:
    """One frame that may move."""

    plausible: PlausibleMotion
    timeout: int
    """News is stale after so many ticks."""
    follower: Follower
    followed: FollowerState
    track: Track | None = None
    doubt: RejectedNews | None = None
    """Why the newest news was not believed."""


class FrameTracker:
    """All frames of a cell that may move."""

    def __init__(self, cell: Cell, events: Events) -> None:
        frames, mechanism = cell.config.frames, cell.config.mechanism
        period = cell.config.timing.period_s
        self._events = events
        self._lead_s = LEAD_PERIODS * period + frames.drive_lag_s
        self._standing = {
            "base": Pose.from_xyz_rpy(mechanism.T_world_base.xyz, mechanism.T_world_base.rpy),
            "carrier": Pose.from_xyz_rpy(frames.T_world_carrier.xyz, frames.T_world_carrier.rpy),
        }
        self._watched = {
            name: self._watch(name, config, cell) for name, config in frames.moving.items()
        }
        self.moved = self._moved()
        """Where Base and Carrier are, for this tick's command."""

    @property
    def watching(self) -> bool:
        """True in a cell with frames that may move."""
        return bool(self._watched)

    @property
    def names(self) -> tuple[str, ...]:
        """The frames that may move."""
        return tuple(self._watched)

    def age(self, name: str, tick: int) -> int | None:
        """Return how many ticks old the newest news of a frame is, None when stale."""
        track = self._watched[name].track
        return None if track is None else tick - track.tick

    def take(self, news: FrameNews, tick: int) -> None:
        """Take in where a frame was. Raises `Refused` for one that does not move in this cell."""
        watched = self._watched.get(news.name)
        if watched is None:
            known = ", ".join(self._watched) or "none"
            raise Refused(Why.UNKNOWN_FRAME, f"{news.name!r} does not move here; there is: {known}")
        if news.tick > tick:
            raise Refused(Why.FUTURE_PICTURE, f"tick {news.tick}, this is tick {tick}")
        believed = self._judge(watched, news, tick)
        if isinstance(believed, RejectedNews):
            if watched.doubt is None or believed.doubt is not watched.doubt.doubt:
                self._tell("frame_rejected", news.name, believed)
            watched.doubt = believed
            return
        if watched.track is None:
            self._events.info("frame_found", news.name, frame=news.name)
        watched.track, watched.doubt = believed, None

    def step(self, tick: int, *, moving: bool) -> Moved:
        """Return where the frames are for the command of `tick`; `moving`: sources lead the arm."""
        for name, w in self._watched.items():
            if w.track is not None and tick - w.track.tick > w.timeout:
                w.track = None
                self._tell("frame_lost", name, w.doubt)
            w.followed = w.follower.step(w.followed, w.track, tick, self._lead_s, not moving)
        if self._watched:
            self.moved = self._moved()
        return self.moved

    def _moved(self) -> Moved:
        base = self.body("base")
        back = -self._lead_s * base.twist
        measured = Pose(rotation_exp(back[3:]) @ base.T.R, base.T.p + back[:3])
        watched = self._watched.get("base")
        track = None if watched is None else watched.track
        acceleration = None if track is None else track.acceleration
        return Moved(base, self.body("carrier"), measured, acceleration)

    def body(self, name: str) -> Body:
        """Return where Base or Carrier is, for this tick's command."""
        watched = self._watched.get(name)
        return Body.standing(self._standing[name]) if watched is None else watched.followed.now

    def _watch(self, name: str, config: MovingFrame, cell: Cell) -> _Watched:
        period, limits = cell.config.timing.period_s, cell.config.limits

        def bounds(linear: float, angular: float) -> np.ndarray:
            return np.repeat([linear, angular], 3)

        plausible = PlausibleMotion(
            period,
            config.least_quality,
            config.speed,
            config.angular_speed,
            *config.slack,
            config.smoothing_s,
            config.acceleration,
            config.angular_acceleration,
            config.extent or (math.inf, math.inf),
            self._standing[name],
        )
        follower = Follower(
            bounds(config.speed, config.angular_speed),
            bounds(config.acceleration, config.angular_acceleration),
            bounds(limits.jerk, limits.angular_jerk),
            period,
        )
        timeout = round(config.timeout_s / period)
        return _Watched(plausible, timeout, follower, follower.standing(self._standing[name]))

    def _judge(self, watched: _Watched, news: FrameNews, tick: int) -> Track | RejectedNews:
        if tick - news.tick > watched.timeout:
            return RejectedNews(NewsRejection.LATE, tick - news.tick, watched.timeout, "ticks")
        T = Pose.from_xyz_rpy(news.xyz, news.rpy)
        twist = None if news.twist is None else np.array(news.twist)
        if news.seen_from == "base":
            base = self._base_at(news.tick, tick)
            T = base.T @ T
            if twist is not None:
                twist = rotate_twist(base.T.R, twist) + base.twist_at(T.p)
        return update_track(watched.track, news.tick, T, twist, news.quality, watched.plausible)

    def _base_at(self, then: int, tick: int) -> Body:
        """Return Base as it was at a tick, a little while before `tick`."""
        watched = self._watched.get("base")
        if watched is None:
            return Body.standing(self._standing["base"])
        period = watched.plausible.period_s
        if watched.track is not None:
            return watched.track.at((then - watched.track.tick) * period)
        # What comes to rest is where it was, but for what it moved since.
        now = watched.followed.now
        back = -((tick - then) * period + self._lead_s) * now.twist
        return Body(Pose(rotation_exp(back[3:]) @ now.T.R, now.T.p + back[:3]), now.twist)

    def _tell(self, event: str, name: str, doubted: RejectedNews | None) -> None:
        """Tell why news was not believed, with value and bound; None: there was none."""
        if doubted is None:
            reason = str(NewsRejection.NO_NEWS)
            self._events.warning(event, f"{name}: {reason}", frame=name, reason=reason)
            return
        self._events.warning(
            event,
            f"{name}: {doubted.words}",
            frame=name,
            reason=str(doubted.doubt),
            value=float(f"{doubted.value:.4g}"),
            bound=float(f"{doubted.bound:.4g}"),
        )
