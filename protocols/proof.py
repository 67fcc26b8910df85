"""Proof that a message comes from the lease's holder: a keyed digest that travels beside it.

Whoever holds the lease shares a secret with the daemon (`agreement.py`) that is never sent. A
message carries, as Zenoh's attachment, 32 bytes:

    epoch (8) ‖ sequence (8) ‖ HMAC-SHA256(secret, full key ‖ epoch ‖ sequence ‖ payload)[:16]

Numbers are big-endian. Epoch and sequence stand here and not in the payload, so that a message of
an old lease, or one that is heard and sent again, is recognised before anything is computed or
decoded. An epoch is below 2⁵⁶: its first byte is zero, and no key runs into it.
"""

import hmac
import struct
from typing import NamedTuple, Self

_FORM = struct.Struct(">QQ16s")
_NUMBERS = struct.Struct(">QQ")

PROOF_BYTES = _FORM.size
"""Length of a proof [B]."""


class Proof(NamedTuple):
    """A proof, read but not judged."""

    epoch: int
    seq: int
    digest: bytes

    @classmethod
    def read(cls, attachment: bytes) -> Self | None:
        """Return the proof in an attachment, None for one of another length."""
        return cls(*_FORM.unpack(attachment)) if len(attachment) == PROOF_BYTES else None

    def holds(self, secret: bytes, key: str, payload: bytes) -> bool:
        """Return whether who knows the secret sent this payload on this full key.

        Takes the same time for any wrong digest.
        """
        right = _digest(secret, key, _NUMBERS.pack(self.epoch, self.seq), payload)
        return hmac.compare_digest(self.digest, right)


def prove(secret: bytes, key: str, epoch: int, seq: int, payload: bytes) -> bytes:
    """Return the attachment for a payload on a full key."""
    numbers = _NUMBERS.pack(epoch, seq)
    return numbers + _digest(secret, key, numbers, payload)


def _digest(secret: bytes, key: str, numbers: bytes, payload: bytes) -> bytes:
    return hmac.digest(secret, key.encode() + numbers + payload, "sha256")[:16]
