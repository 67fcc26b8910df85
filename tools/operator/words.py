"""Operators' words for events, faults, limits, passages and refusals."""

import tomllib
from pathlib import Path
from typing import Any, Final, TypedDict

from ...config.errors import printable
from ...protocols.messages import requests
from ...protocols.messages.telemetry import Event, State

_WORDS: Final[dict[str, Any]] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
)
"""The words of `words.toml`, by kind and name."""


class EventWords(TypedDict):
    """Event, cause, and a person's next step; that is empty where there is nothing to do."""

    sentence: str
    next: str


def _told(kind: str, name: str, sentence: str, after: str = "") -> EventWords:
    """Return the words for a name; `sentence` and `after` where there are none."""
    found = _WORDS[kind].get(name, {"says": sentence, "next": after})
    return EventWords(sentence=found["says"], next=found.get("next", ""))


def _plain(kind: str, name: str, otherwise: str = "") -> str:
    """Return the words for a name, where a kind has one sentence for each."""
    said: str = _WORDS[kind].get(name, otherwise)
    return said


def limit_words(name: str) -> str:
    """Return one limit as a sentence; `name` is `KIND` or `KIND:WHICH`."""
    kind, _, which = name.partition(":")
    if said := _plain("limits", kind):
        return said.format(which=which or "a joint")
    plain = kind.replace("_", " ")
    return f"Limited: {plain}" + (f" ({which})." if which else ".")


def passage_words(phase: str, reason: str) -> str:
    """Return a phase of the passage as a sentence, with why there is no way."""
    said = _plain("phases", phase, phase.replace("_", " ").capitalize() + ".")
    because = _plain("reasons", reason, reason.replace("_", " "))
    return f"{said} {because}".strip()


def refusal_words(reply: requests.Reply) -> str:
    """Return a refusal as sentences: its detail, and what to do next.

    The detail is left as it is: it may begin with the name of a person or of a field.
    """
    said = reply.detail or reply.reason.replace("_", " ")
    return f"{said.rstrip('.')}. {_plain('refusals', reply.reason)}".strip()


def event_words(event: Event) -> EventWords:
    """Return an event as a sentence with its cause, and what to do next."""
    if event.name == "mode":
        return mode_words(str(event.values.get("mode", "")))
    if event.name == "stopping":
        reason = event.detail
        return _told("stops", reason, f"The arm stopped: {reason}.", "Mend the cause, then resume.")
    if event.name.endswith("_refused"):
        after = _plain("refusals", str(event.values.get("reason", "")))
        return EventWords(sentence=f"Refused: {event.detail}.", next=after)
    if event.name in _WORDS["events"]:
        words = _told("events", event.name, "")
        said = words["sentence"].format(detail=event.detail)
        words["sentence"] = said.replace(" :", ":").replace(": .", ".")
        return words
    plain = event.name.replace("_", " ").capitalize()
    words = EventWords(
        sentence=f"{plain}: {event.detail}." if event.detail else f"{plain}.", next=""
    )
    if event.severity == "error":
        words["sentence"] += " The drives were stopped."
        cause = str(event.values.get("cause", event.name))
        words["next"] = _plain("faults", cause, "Find and mend the cause, reset, then enable.")
    return words


def mode_words(mode: str) -> EventWords:
    """Return a mode as a sentence, and what to do next."""
    return _told("modes", mode, f"{mode.capitalize()}.")


def event_line(event: Event) -> str:
    """Return an event as one line for the terminal: its sentence, its values, what to do next."""
    words = event_words(event)
    said = words["sentence"]
    if event.detail not in said and event.name != "mode":
        said += f" ({event.detail})"
    shown = {key: value for key, value in event.values.items() if str(value) not in said}
    values = "".join(f" {key}={value}" for key, value in shown.items())
    mark = {"info": " ", "warning": "!", "error": "#"}[event.severity]
    after = f" -> {words['next']}" if words["next"] else ""
    return printable(f"{mark} {event.time_s:9.2f} s {event.name}: {said}{values}{after}")


# --- Why the arm does what it does now, in one sentence, and what to do next. Pure ----------------
CAUSES = ("stopping",)  # events that say why the arm stopped, beside errors


def is_cause(event: Event) -> bool:
    """Return whether an event says why the arm stopped."""
    return event.severity == "error" or event.name in CAUSES


def why(state: State, cause: Event | None) -> EventWords:
    """Return why the arm is in its mode; `cause` is the newest event that said why it stopped."""
    if state.mode == "fault":
        words = mode_words("fault") if cause is None else event_words(cause)
        if state.protective_stop:
            words["next"] += " A protective stop is set, too: clear it."
        return words
    if state.protective_stop:
        return EventWords(
            sentence="Protective stop: the arm may not move.",
            next="Clear it, then resume." if state.mode == "hold" else "Clear it.",
        )
    if cause is not None and state.mode in ("stopping", "hold"):
        return event_words(cause)
    words = mode_words(state.mode)
    if state.mode in ("ready", "hold") and state.lease_holder is not None:
        words["next"] = f"{state.lease_holder} has the lease and may go on."
    return words
