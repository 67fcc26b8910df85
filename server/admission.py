"""Who may say what, and how fresh it has to be: every command and request passes here.

Refused are: bytes that are no message; a command without the lease, of an old epoch, out of
order, or based on a picture older than the cell allows or older than the last enable. So a
command that was queued anywhere on its way is dead, not late; and no clocks are compared.
"""

from dataclasses import dataclass
from enum import StrEnum

from ..protocols.codec import CodecError, decode
from ..protocols.messages import Command, Message
from ..protocols.topics import Flow, Topic
from .lease import Lease


class Why(StrEnum):
    """Why a well-formed command was refused."""

    NO_LEASE = "no_lease"
    WRONG_TOKEN = "wrong_token"
    OLD_EPOCH = "old_epoch"
    OUT_OF_ORDER = "out_of_order"
    OLD_PICTURE = "old_picture"
    FUTURE_PICTURE = "future_picture"
    BEFORE_ENABLE = "before_enable"
    NOT_ENABLED = "not_enabled"
    NOT_NOW = "not_now"
    OUT_OF_RANGE = "out_of_range"
    WRONG_JOINTS = "wrong_joints"
    UNKNOWN_POSTURE = "unknown_posture"
    UNKNOWN_PAYLOAD = "unknown_payload"
    LEASE_TAKEN = "lease_taken"
    PROTECTIVE_STOP = "protective_stop"
    NOT_YOURS = "not_yours"
    UNKNOWN_CAMERA = "unknown_camera"
    UNKNOWN_OBSTACLE = "unknown_obstacle"
    FIXED_OBSTACLE = "fixed_obstacle"
    TOO_MANY_OBSTACLES = "too_many_obstacles"
    UNKNOWN_FRAME = "unknown_frame"
    SENSOR_STALE = "sensor_stale"
    TOUCHED = "touched"
    STILL_WRONG = "still_wrong"
    UNSTABLE_GAIN = "unstable_gain"


class Refused(Exception):
    """A command or request was refused: `reason` for programs, the text for people."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason
        self.detail = detail


@dataclass(frozen=True)
class Now:
    """What admission has to know of this tick."""

    time_s: float
    tick: int
    enabled_since: int | None
    """Tick of the last enable or resume, None while not ENABLED."""


class Admission:
    """The lease and the order of what its holder sends."""

    def __init__(self, period_s: float, max_command_age_s: float, lease_timeout_s: float) -> None:
        self._max_age_ticks = max(1, round(max_command_age_s / period_s))
        self._timeout_s = lease_timeout_s
        self.lease = Lease()
        self.last_seq: dict[str, int] = {}
        self.age_ticks: int | None = None
        """How old the picture was that the last accepted command was based on."""

    def admit(self, topic: Topic, payload: bytes, now: Now) -> Message:
        """Return the message of a payload that may act now. Raises `Refused`."""
        try:
            message = decode(topic, payload)
        except CodecError as error:
            raise Refused(error.reason, error.detail) from None
        if isinstance(message, Command):
            self._prove(topic, message, now)
            needs_enabled = topic.flow is Flow.COMMAND and topic.key != "cmd/keepalive"
            if needs_enabled:
                self._current(message, now)
            self.last_seq[topic.key] = message.seq
            self.age_ticks = now.tick - message.seen_tick
        return message

    def grant(self, operator: str, token: str, now: Now) -> Lease:
        """Grant the lease to an operator. Raises `Refused` while another's is alive."""
        if self.lease.alive(now.time_s):
            left = self.lease.expires_s - now.time_s
            raise Refused(
                Why.LEASE_TAKEN, f"{self.lease.holder} holds the lease for {left:.2f} s more"
            )
        self.lease = self.lease.granted(operator, token, now.time_s, self._timeout_s)
        self.last_seq = {}
        self.age_ticks = None
        return self.lease

    def renew(self, now: Now) -> None:
        """Renew the lease that was just proven."""
        self.lease = self.lease.renewed(now.time_s, self._timeout_s)

    def end(self) -> None:
        """End the lease; its token proves nothing any more."""
        self.lease = self.lease.ended()
        self.last_seq = {}

    def _prove(self, topic: Topic, command: Command, now: Now) -> None:
        lease = self.lease
        if not lease.alive(now.time_s):
            raise Refused(Why.NO_LEASE, "nobody holds the lease")
        if command.epoch != lease.epoch:
            raise Refused(Why.OLD_EPOCH, f"epoch {command.epoch}, the lease's is {lease.epoch}")
        if not lease.proves(command.token):
            raise Refused(Why.WRONG_TOKEN, f"the token is not that of {lease.holder}")
        last = self.last_seq.get(topic.key, -1)
        if command.seq <= last:
            raise Refused(Why.OUT_OF_ORDER, f"seq {command.seq} after {last}")
        if command.seen_tick > now.tick:
            raise Refused(
                Why.FUTURE_PICTURE, f"seen_tick {command.seen_tick}, this is tick {now.tick}"
            )
        age = now.tick - command.seen_tick
        if age > self._max_age_ticks:
            raise Refused(
                Why.OLD_PICTURE,
                f"based on a picture {age} ticks old, at most {self._max_age_ticks}",
            )

    def _current(self, command: Command, now: Now) -> None:
        if now.enabled_since is None:
            raise Refused(Why.NOT_ENABLED, "the arm is not enabled")
        if command.seen_tick < now.enabled_since:
            raise Refused(
                Why.BEFORE_ENABLE,
                f"seen_tick {command.seen_tick}, enabled since tick {now.enabled_since}",
            )
