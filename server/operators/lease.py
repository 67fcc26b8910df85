"""The right to command: held by one operator at a time, renewed or lost. Pure."""

from dataclasses import dataclass, replace

from ...protocols.proof import Proof


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
        return replace(self, expires_s=now_s + timeout_s)

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
