"""Fuzzes every topic's decoder with bytes that are no message, or nearly one."""

from hypothesis import strategies as st
from telerobot.protocols.codec import CodecError, decode
from telerobot.protocols.topics import TOPICS

from .. import drawn
from .messages import Said, fields_of, said
from .outcome import Outcome

INPUTS = 500
"""Payloads of one job [1]."""
PAYLOADS = st.one_of([said(topic, fields_of(topic.message)) for topic in TOPICS])


def play(seed: int) -> Outcome:
    """Decode payloads; each is a message or refused by name."""
    outcome = Outcome("codec", seed)

    def judge(one: Said) -> list[str]:
        outcome.inputs["payloads decoded"] += 1
        try:
            decode(one.topic, one.payload(1))
            outcome.inputs["messages among them"] += 1
        except CodecError as refusal:
            if "\n" in refusal.detail or len(refusal.detail) > 400:
                return [f"{one.topic.key}: no refusal in one line: {refusal.detail!r}"]
        except Exception as error:  # noqa: BLE001  that nothing else is raised is what is tried
            return [outcome.raised(error, one.topic.key)]
        return []

    outcome.reasons = drawn.play(PAYLOADS, judge, f"codec {seed}", INPUTS)
    return outcome
