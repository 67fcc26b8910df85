"""Findings of a check, shown as one line each or as JSON."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from ...config.errors import printable

Value = str | int | float | bool | None


class Severity(StrEnum):
    """Severity of a finding; only an error makes the command fail."""

    OK = "ok"
    WARN = "warn"
    ERROR = "error"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at: what was judged, how, and with which numbers."""

    check: str
    status: Severity
    text: str
    values: Mapping[str, Value] = field(default_factory=dict)


def graded(value: float, warn: float, error: float) -> Severity:
    """Return ERROR for a value above `error`, WARN above `warn`, else OK."""
    if value > error:
        return Severity.ERROR
    return Severity.WARN if value > warn else Severity.OK


def failed(findings: Sequence[Finding]) -> bool:
    """Return whether one of the findings is an error."""
    return any(f.status is Severity.ERROR for f in findings)


def table(findings: Sequence[Finding]) -> str:
    """Return the findings as lines of status, check and text."""
    width = max((len(f.check) for f in findings), default=0)
    return "\n".join(
        printable(f"{f.status:<5}  {f.check:<{width}}  {f.text}", 100_000) for f in findings
    )


def to_json(head: Mapping[str, Value], findings: Sequence[Finding]) -> str:
    """Return one JSON object: `head`, and the findings as a list."""
    rows = [
        {"check": f.check, "status": f.status.value, "text": f.text, "values": dict(f.values)}
        for f in findings
    ]
    return json.dumps({**head, "findings": rows}, indent=2)


def summary(findings: Sequence[Finding]) -> str:
    """Return how many of which status there are, in words."""
    errors = sum(f.status is Severity.ERROR for f in findings)
    warnings = sum(f.status is Severity.WARN for f in findings)
    return f"{len(findings)} checks, {errors} errors, {warnings} warnings"
