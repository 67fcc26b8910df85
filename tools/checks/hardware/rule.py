"""One rule of a profile, and what became of it on a drive."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from .tried_drive import TriedDrive


class RuleOutcome(StrEnum):
    """Ways in which a rule can end."""

    KEPT = "kept"
    BROKEN = "broken"
    ABSENT = "absent"
    """It is about something optional that the drive does not have."""


@dataclass(frozen=True)
class Rule:
    """Sentence of a profile: where it stands, in short words, and how it is tried."""

    clause: str
    promise: str
    judge: Callable[[TriedDrive], None]
    """Raises `BrokenError` or `AbsentError`."""


class RuleVerdict(NamedTuple):
    """Result of one rule."""

    rule: Rule
    outcome: RuleOutcome
    detail: str
