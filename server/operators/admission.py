"""Admission of every command and request: the lease and its proof, order, and freshness."""

from collections.abc import Callable
from dataclasses import dataclass

from ...protocols.codec import CodecError, decode_as
from ...protocols.messages import requests
from ...protocols.messages.messages import Command, Message
from ...protocols.proof import PROOF_BYTES, KeyPair, Proof
from ...protocols.topics import LEASE, Flow, Topic
from ..refusals import Refused, Why

# --- The right to command: held by one operator at a time, renewed or lost. Pure ------------------


@dataclass(frozen=True)
class Lease:
    """The holder of the right to command and its end; `epoch` counts every lease ever granted."""

    holder: str | None = None
    secret: bytes = b""
    epoch: int = 0
    expires_s: float = 0.0

    def alive(self, now_s: float) -> bool:
        """Return whether somebody holds the lease now."""
        return self.holder is not None and now_s < self.expires_s

    def granted(self, operator: str, secret: bytes, now_s: float, timeout_s: float) -> "Lease":
        """Return the lease of a new holder, with a new epoch."""
        return Lease(operator, secret, self.epoch + 1, now_s + timeout_s)

    def renewed(self, now_s: float, timeout_s: float) -> "Lease":
        """Return the same lease, good for another timeout."""
        return Lease(self.holder, self.secret, self.epoch, now_s + timeout_s)

    def ended(self) -> "Lease":
        """Return the lease that nobody holds."""
        return Lease(epoch=self.epoch)

    def proven_by(self, proof: Proof, key: str, payload: bytes) -> bool:
        """Return whether the holder made this proof, for this payload on this full key."""
        return (
            self.holder is not None
            and proof.epoch == self.epoch
            and proof.holds(self.secret, key, payload)
        )


# --- Admission of every command and request: proof of the lease, order, and freshness -------------
#
# Refused are: a command that does not prove the lease, is of an old epoch or out of order;
# bytes that are no message; a command based on a snapshot older than the cell allows or older
# than the last enable. So a command that was queued anywhere on its way is dead, not late; and
# no clocks are compared. Proof comes first: nothing that lacks it is decoded.

FIRST_SEQ = 2**48
"""A lease's first sequence number is below this [1]."""

LEAP = 2**20
"""A sequence number is at most so far ahead of the newest: none locks its sender out [1]."""


@dataclass(frozen=True)
class Instant:
    """Time of a tick, as admission judges freshness by it."""

    time_s: float
    tick: int
    enabled_since: int | None
    """Tick of the last enable or resume, None while not ENABLED."""


class Admission:
    """The lease and the order of what its holder sends."""

    def __init__(
        self, cell: str, period_s: float, max_command_age_s: float, lease_timeout_s: float
    ) -> None:
        self._cell = cell
        self._max_age_ticks = max(1, round(max_command_age_s / period_s))
        self._timeout_s = lease_timeout_s
        self.lease = Lease()
        self._proven_seq: dict[str, int] = {}
        self._newest_seq: int | None = None
        self.last_seq: dict[str, int] = {}
        """Of the newest message that was accepted on each key."""
        self.age_ticks: int | None = None
        """Age of the telemetry snapshot that the last accepted command was based on."""

    def prove(self, topic: Topic, payload: bytes, attachment: bytes, now: Instant) -> Proof:
        """Return the proof that came with a payload, if it holds. Raises `Refused`.

        Only what is proven moves the sequence, and nothing is proven twice.
        """
        lease = self.lease
        if not lease.alive(now.time_s):
            raise Refused(Why.NO_LEASE, "nobody holds the lease")
        proof = Proof.read(attachment)
        if proof is None:
            raise Refused(
                Why.WRONG_PROOF, f"a proof of {len(attachment)} bytes instead of {PROOF_BYTES}"
            )
        if proof.epoch != lease.epoch:
            raise Refused(Why.OLD_EPOCH, f"epoch {proof.epoch}, the lease's is {lease.epoch}")
        last = self._proven_seq.get(topic.key, -1)
        most = FIRST_SEQ if self._newest_seq is None else self._newest_seq + LEAP
        if not last < proof.seq <= most:
            raise Refused(Why.OUT_OF_ORDER, f"seq {proof.seq} after {last}, at most {most}")
        if not lease.proven_by(proof, topic.full_key(self._cell), payload):
            raise Refused(Why.WRONG_PROOF, f"not proven to come from {lease.holder}")
        self._proven_seq[topic.key] = proof.seq
        self._newest_seq = max(self._newest_seq or 0, proof.seq)
        return proof

    def admit(self, topic: Topic, payload: bytes, proof: Proof | None, now: Instant) -> Message:
        """Return the message of a payload that may act now. Raises `Refused`.

        Any message that is proven and recent renews the lease: junk on one key cannot end it.
        """
        if proof is None and issubclass(topic.message, Command):
            raise Refused(Why.WRONG_PROOF, "no proof of the lease")
        try:
            message = decode_as(topic.message, payload, topic.max_bytes)
        except CodecError as error:
            raise Refused(error.reason, error.detail) from None
        if isinstance(message, Command) and proof is not None:
            self._require_recent(message, proof, now)
            self.lease = self.lease.renewed(now.time_s, self._timeout_s)
            if topic.flow is Flow.COMMAND and topic.key != "cmd/keepalive":
                if now.enabled_since is None:
                    raise Refused(Why.NOT_ENABLED, "the arm is not enabled")
                if message.seen_tick < now.enabled_since:
                    seen = f"seen_tick {message.seen_tick}"
                    raise Refused(
                        Why.BEFORE_ENABLE, f"{seen}, enabled since tick {now.enabled_since}"
                    )
            self.last_seq[topic.key] = proof.seq
            self.age_ticks = now.tick - message.seen_tick
        return message

    def require_free(self, now: Instant) -> int:
        """Return the epoch of the lease that may be granted now.

        Raises `Refused` while one is alive.
        """
        if self.lease.alive(now.time_s):
            left = self.lease.expires_s - now.time_s
            raise Refused(
                Why.LEASE_TAKEN, f"{self.lease.holder} holds the lease for {left:.2f} s more"
            )
        return self.lease.epoch + 1

    def grant(self, operator: str, secret: bytes, now: Instant) -> Lease:
        """Grant the lease to an operator. Raises `Refused` while another's is alive."""
        self.require_free(now)
        self.lease = self.lease.granted(operator, secret, now.time_s, self._timeout_s)
        self._forget_order()
        self.age_ticks = None
        return self.lease

    def renew(self, now: Instant) -> None:
        """Renew the lease."""
        self.lease = self.lease.renewed(now.time_s, self._timeout_s)

    def end(self) -> None:
        """End the lease; its secret proves nothing any more."""
        self.lease = self.lease.ended()
        self._forget_order()

    def holds(self, proof: Proof | None, now: Instant) -> bool:
        """Return whether a proof that held is of the lease that is alive now."""
        lease = self.lease
        return proof is not None and lease.alive(now.time_s) and proof.epoch == lease.epoch

    def _forget_order(self) -> None:
        self._proven_seq, self._newest_seq, self.last_seq = {}, None, {}

    def _require_recent(self, command: Command, proof: Proof, now: Instant) -> None:
        """Look again at a proof that held, as its lease may have ended within the tick, and when.

        Raises `Refused`.
        """
        lease = self.lease
        if not lease.alive(now.time_s):
            raise Refused(Why.NO_LEASE, "nobody holds the lease")
        if proof.epoch != lease.epoch:
            raise Refused(Why.OLD_EPOCH, f"epoch {proof.epoch}, the lease's is {lease.epoch}")
        if command.seen_tick > now.tick:
            raise Refused(
                Why.FUTURE_PICTURE, f"seen_tick {command.seen_tick}, this is tick {now.tick}"
            )
        age = now.tick - command.seen_tick
        if age > self._max_age_ticks:
            raise Refused(
                Why.OLD_PICTURE,
                f"based on a snapshot {age} ticks old, at most {self._max_age_ticks}",
            )


class Grants:
    """Answers requests for the lease, with a secret that is agreed and never sent.

    `new_key` makes 32 random bytes for each request.
    """

    def __init__(self, cell: str, admission: Admission, new_key: Callable[[], bytes]) -> None:
        self._lease_key = LEASE.full_key(cell)
        self._admission = admission
        self._new_key = new_key

    def grant(self, asked: requests.LeaseRequest, now: Instant) -> requests.Reply:
        """Grant the lease. Raises `Refused` while another's is alive, and for an unusable key."""
        epoch = self._admission.require_free(now)
        pair = KeyPair(self._new_key())
        try:
            secret = pair.agree_with_operator(asked.key, self._lease_key, epoch)
        except ValueError:
            raise Refused(Why.WRONG_KEY, "key is no public key of X25519") from None
        self._admission.grant(asked.operator, secret, now)
        return requests.Reply(ok=True, tick=now.tick, key=pair.public, epoch=epoch)
