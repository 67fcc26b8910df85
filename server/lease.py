"""The right to command: held by one operator at a time, renewed or lost. Pure."""

import hmac
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Lease:
    """Who may command until when; `epoch` counts every lease ever granted."""

    holder: str | None = None
    token: str = ""
    epoch: int = 0
    expires_s: float = 0.0

    def alive(self, now_s: float) -> bool:
        """Return whether somebody holds the lease now."""
        return self.holder is not None and now_s < self.expires_s

    def granted(self, operator: str, token: str, now_s: float, timeout_s: float) -> "Lease":
        """Return the lease of a new holder, with a new epoch."""
        return Lease(operator, token, self.epoch + 1, now_s + timeout_s)

    def renewed(self, now_s: float, timeout_s: float) -> "Lease":
        """Return the same lease, good for another timeout."""
        return replace(self, expires_s=now_s + timeout_s)

    def ended(self) -> "Lease":
        """Return the lease that nobody holds."""
        return Lease(epoch=self.epoch)

    def proves(self, token: str) -> bool:
        """Return whether `token` is the holder's; takes the same time for any wrong one."""
        return self.holder is not None and hmac.compare_digest(
            self.token.encode(), token.encode("utf-8", "surrogatepass")
        )
