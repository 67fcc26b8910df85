"""Keys for simulations, equal in equal runs. Real ones come from `protocols.agreement`."""

import hashlib
import itertools
from collections.abc import Callable


def seeded_keys(owner: str) -> Callable[[], bytes]:
    """Return a source of 32 bytes at a time, the same in every run."""
    numbers = itertools.count(1)
    return lambda: hashlib.sha256(f"{owner} {next(numbers)}".encode()).digest()
