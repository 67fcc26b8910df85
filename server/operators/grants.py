"""Grants of the lease: who asks first gets it, with a secret that is agreed and never sent."""

from collections.abc import Callable

from ...protocols.agreement import KeyPair
from ...protocols.messages import requests
from ...protocols.topics import LEASE
from ..refusals import Refused, Why
from .admission import Admission, Instant


class Grants:
    """Answers requests for the lease; `new_key` makes 32 random bytes for each."""

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
