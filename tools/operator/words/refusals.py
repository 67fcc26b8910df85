"""Refusals in words: why, and what to do next."""

from ....protocols.messages import requests

NEXT = {
    "no_lease": "Take control first (the lease).",
    "wrong_proof": "Take control again (the lease).",
    "old_epoch": "The lease has changed hands: take it again.",
    "old_picture": "The network was too slow: try again.",
    "future_picture": "The daemon has started anew: try again.",
    "before_enable": "It was sent before the arm was enabled: send it again.",
    "not_enabled": "Enable the arm first.",
    "lease_taken": "Ask its holder to release it, or wait until it runs out.",
    "protective_stop": "Clear the protective stop, then resume.",
    "not_yours": "Who asked for the stop clears it, or the lease's holder.",
    "anothers_obstacle": "See who else tells of an obstacle of that name, and stop one of them.",
    "unnamed_sender": "With certificates a sensor tells of obstacles under its own name.",
    "sensor_stale": "Wait for fresh data of the sensor, then resume.",
    "touched": "Look at what the arm touches; resume once it is free.",
    "still_wrong": "Mend the cause that the message names, then reset.",
    "unstable_gain": "Choose a smaller gain.",
    "unstable_frame": "Put the MRF nearer to the tool's tip, or lower the gains about its axes.",
    "unstable_payload": "Tell a payload that the loop can carry, or slow it down.",
    "no_answer": "The daemon did not answer: is it running?",
    "not_certified": "The certificate or login that was used does not allow it.",
}
"""Next step for a person, by the reason's name."""


def refusal_words(reply: requests.Reply) -> str:
    """Return a refusal as sentences: its detail, and what to do next.

    The detail is left as it is: it may begin with the name of a person or of a field.
    """
    said = reply.detail or reply.reason.replace("_", " ")
    return f"{said.rstrip('.')}. {NEXT.get(reply.reason, '')}".strip()
