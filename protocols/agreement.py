"""How operator and daemon come to share the lease's secret without sending it.

Both make a key pair for this one lease (X25519, RFC 7748). The request for the lease carries the
operator's public key, the reply the daemon's, and both derive (HKDF-SHA256, RFC 5869, no salt)

    secret = HKDF(X25519(own private, other's public),
                  full key of operator/lease ‖ epoch (8, big-endian) ‖ operator's ‖ daemon's public)

Who hears both public keys learns nothing of the secret. Who stands between the two, or answers in
the daemon's place, is kept out by TLS and Zenoh's access control, and by nothing here.
"""

import secrets

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

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
