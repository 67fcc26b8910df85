"""Fuzzes every topic's decoder with bytes that are no message, or nearly one."""

import random

from telerobot.protocols.codec import CodecError, decode, encode
from telerobot.protocols.topics import TOPICS

from .inputs.payloads import junk, mutated
from .inputs.values import Values
from .outcome import Outcome

INPUTS = 2000
"""Payloads of one job [1]."""


def play(seed: int) -> Outcome:
    """Decode payloads; each is a message or refused by name."""
    outcome, dice = Outcome("codec", seed), random.Random(f"codec {seed}")
    values = Values(dice)
    for _ in range(INPUTS):
        topic = dice.choice(TOPICS)
        payload = junk(values, topic)
        if dice.random() < 0.5:
            given = {"seen_tick": 1} if topic.needs_proof else {}
            message = values.message(topic.message, **given)
            if message is None:
                continue
            payload = encode(message)
            if dice.random() < 0.7:
                payload = mutated(dice, payload)
        outcome.inputs["payloads decoded"] += 1
        try:
            decode(topic, payload)
        except CodecError as refusal:
            if "\n" in refusal.detail or len(refusal.detail) > 400:
                outcome.reasons.append(f"{topic.key}: no refusal in one line: {refusal.detail!r}")
        except Exception as error:  # noqa: BLE001  that nothing else is raised is what is tried
            outcome.raised(error, f"{topic.key} {payload[:40].hex()}…")
    return outcome
