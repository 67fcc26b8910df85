"""The lease's secret: agreed without being sent, proven by a keyed digest beside each message."""

import hmac
import secrets
import struct
from typing import NamedTuple, Self

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

# --- How operator and daemon come to share the lease's secret without sending it ------------------
#
# Both make a key pair for this one lease (X25519, RFC 7748). The request for the lease carries
# the operator's public key, the reply the daemon's, and both derive (HKDF-SHA256, RFC 5869, no
# salt)
#
# secret = HKDF(X25519(own private, other's public), full key of operator/lease ‖ epoch (8,
# big-endian) ‖ operator's ‖ daemon's public)
#
# Who hears both public keys learns nothing of the secret. Who stands between the two, or
# answers in the daemon's place, is kept out by TLS and Zenoh's access control, and by nothing
# here.

KEY_BYTES = 32
"""Length of private keys, public keys and secrets [B]."""


def random_key() -> bytes:
    """Return 32 random bytes, for a private key or a secret."""
    return secrets.token_bytes(KEY_BYTES)


class KeyPair:
    """A key pair for one lease, from 32 random bytes."""

    def __init__(self, private: bytes) -> None:
        self._private = X25519PrivateKey.from_private_bytes(private)
        self.public = self._private.public_key().public_bytes_raw()

    def agree_with_daemon(self, daemon: bytes, lease_key: str, epoch: int) -> bytes:
        """Return the operator's copy of the secret. Raises `ValueError` for an unusable key."""
        return self._derive(daemon, lease_key, epoch, self.public + daemon)

    def agree_with_operator(self, operator: bytes, lease_key: str, epoch: int) -> bytes:
        """Return the daemon's copy of the secret. Raises `ValueError` for an unusable key."""
        return self._derive(operator, lease_key, epoch, operator + self.public)

    def _derive(self, other: bytes, lease_key: str, epoch: int, publics: bytes) -> bytes:
        shared = self._private.exchange(X25519PublicKey.from_public_bytes(other))
        context = lease_key.encode() + epoch.to_bytes(8, "big") + publics
        return HKDF(SHA256(), KEY_BYTES, salt=None, info=context).derive(shared)


# --- Proof that a message comes from the lease's holder: a keyed digest that travels beside it ----
#
# Whoever holds the lease shares a secret with the daemon (`proof.py`) that is never sent. A
# message carries, as Zenoh's attachment, 32 bytes:
#
#     epoch (8) ‖ sequence (8) ‖ HMAC-SHA256(secret, full key ‖ epoch ‖ sequence ‖ payload)[:16]
#
# Numbers are big-endian. Epoch and sequence stand here and not in the payload, so that a
# message of an old lease, or one that is heard and sent again, is recognised before anything is
# computed or decoded. An epoch is below 2⁵⁶: its first byte is zero, and no key runs into it.

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
