"""The protective stops that are latched, and who may clear them. Pure."""

import hashlib

from ..refusals import Refused, Why

MOST = 16
"""Most sealed stops that are kept apart; further ones are the lease holder's to clear [1]."""


class ProtectiveStops:
    """Every stop that was asked for and is not cleared; the arm may move once there is none.

    Each is kept on its own: whoever asks for one cannot clear another's by clearing that.
    """

    def __init__(self) -> None:
        self._sealed: dict[bytes, str] = {}
        self._unsealed: str | None = None

    @property
    def asked_by(self) -> str | None:
        """Name of an operator whose stop is latched, None without any."""
        return self._unsealed or next(reversed(self._sealed.values()), None)

    def latch(self, operator: str, seal: bytes | None) -> None:
        """Latch a stop; `seal` is the SHA-256 of what clears it, None where only a lease does."""
        if seal is not None and (seal in self._sealed or len(self._sealed) < MOST):
            self._sealed[seal] = operator
        else:
            self._unsealed = operator

    def clear(self) -> None:
        """Clear all, for the lease's holder."""
        self._sealed.clear()
        self._unsealed = None

    def open(self, opens: bytes | None) -> None:
        """Clear the stop whose seal this opens. Raises `Refused` where it opens none."""
        seal = hashlib.sha256(opens or b"").digest()
        if opens is None or self._sealed.pop(seal, None) is None:
            asker = self.asked_by
            raise Refused(
                Why.NOT_YOURS, f"asked by {asker}: {asker}'s seal or a proof of the lease clears it"
            )
