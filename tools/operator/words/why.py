"""Why the arm does what it does now, in one sentence, and what to do next. Pure."""

from ....protocols.messages.telemetry import Event, State
from .events import EventWords, event_words, mode_words

CAUSES = ("stopping",)
"""Events that say why the arm stopped, beside errors."""


def is_cause(event: Event) -> bool:
    """Return whether an event says why the arm stopped."""
    return event.severity == "error" or event.name in CAUSES


def why(state: State, cause: Event | None) -> EventWords:
    """Return why the arm is in its mode; `cause` is the newest event that said why it stopped."""
    if state.mode == "fault":
        sentence, after = mode_words("fault")
        words = EventWords(sentence=sentence, next=after) if cause is None else event_words(cause)
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
    sentence, after = mode_words(state.mode)
    if state.mode in ("ready", "hold") and state.lease_holder is not None:
        after = f"{state.lease_holder} has the lease and may go on."
    return EventWords(sentence=sentence, next=after)
