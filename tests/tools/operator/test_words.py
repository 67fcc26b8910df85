"""Events, limits and refusals in words: whatever is told becomes a sentence."""

import re
from pathlib import Path
from typing import get_args

import pytest
from telerobot.drivers.device import Cause
from telerobot.protocols.messages import requests
from telerobot.protocols.messages.perception import ContourNews
from telerobot.protocols.messages.telemetry import Event, State
from telerobot.server.perception.ahead import REASONS, REFUSALS
from telerobot.server.refusals import Why
from telerobot.tools.operator.words import (
    event_line,
    event_words,
    limit_words,
    passage_words,
    refusal_words,
    why,
)

SERVER = Path(__file__).resolve().parents[3] / "server"
SCANNING = SERVER / "perception" / "scanning"


def event(name, severity="warning", detail="Ann: 3 mm", **values):
    return Event(
        id=1, tick=1, time_s=0.0, name=name, severity=severity, detail=detail, values=values
    )


def told_by_the_server():
    text = "".join(path.read_text() for path in SERVER.rglob("*.py"))
    return sorted(set(re.findall(r'\.(?:info|warning|error|standing)\(\s*"([a-z_]+)"', text)))


def test_the_server_tells_of_something():
    assert {"lease_expired", "touched", "mode"} <= set(told_by_the_server())


@pytest.mark.parametrize("name", told_by_the_server())
def test_every_event_of_the_server_is_a_sentence(name):
    words = event_words(event(name, mode="enabled"))
    assert re.fullmatch(r"[A-Z][^{}]*\.", words["sentence"]), words
    assert "_" not in words["sentence"]
    assert words["next"] == "" or re.fullmatch(r"[A-Z][^{}]*[.?]", words["next"])


@pytest.mark.parametrize("cause", list(Cause))
def test_every_fault_says_what_to_do_next(cause):
    words = event_words(event("drive_trouble", "error", cause=str(cause)))
    assert "Ann: 3 mm" in words["sentence"]
    assert "eset" in words["next"]


def test_a_refusal_says_why_and_what_to_do_next():
    reply = requests.Reply(ok=False, reason=Why.LEASE_TAKEN, detail="held by ann")
    assert (
        refusal_words(reply)
        == "held by ann. Ask its holder to release it, or wait until it runs out."
    )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("joint_limit:s1", "Joint s1 is near the end of its range."),
        ("tool_speed", "The tool is at its speed bound."),
        ("of_tomorrow:w2", "Limited: of tomorrow (w2)."),
    ],
)
def test_a_limit_is_a_sentence(name, words):
    assert limit_words(name) == words


@pytest.mark.parametrize(
    ("mode", "cause", "said", "after"),
    [
        ("hold", "lease run out", "nothing was heard", "Take control, then resume."),
        ("hold", "hold asked", "asked to hold", "Resume to go on."),
        ("hold", "overruns", "came late", "See what keeps the daemon's machine busy, then resume."),
        ("hold", "gate open", "gate open", "Mend the cause, then resume."),
        ("ready", "hold asked", "The drives are off.", "Take control, then enable."),
    ],
)
def test_why_names_the_cause_of_a_stop_and_the_way_on(mode, cause, said, after):
    state = State.model_construct(mode=mode, protective_stop=False, lease_holder=None)
    words = why(state, event("stopping", detail=cause))
    assert said in words["sentence"]
    assert words["next"] == after


def test_a_fault_is_told_with_its_cause_before_a_protective_stop():
    state = State.model_construct(mode="fault", protective_stop=True, lease_holder="ann")
    words = why(state, event("drive_trouble", "error", detail="w2: following error"))
    assert "w2: following error" in words["sentence"]
    assert words["next"].endswith("A protective stop is set, too: clear it.")
    assert "eset" in words["next"]


def told_by_a_contour(field):
    return get_args(ContourNews.model_fields[field].annotation)


def reasons_of_the_reflex():
    text = "".join(path.read_text() for path in SCANNING.glob("*.py"))
    found = re.findall(r'"((?:base|column|no|sequence)_[a-z0-9]+)"', text)
    return sorted({"held_up", *found, *REASONS})


@pytest.mark.parametrize("phase", told_by_a_contour("phase"))
def test_every_phase_of_a_passage_is_a_sentence(phase):
    assert re.fullmatch(r"[A-Z][^_]{12,}\.", passage_words(phase, ""))


def test_the_daemon_knows_the_reasons_of_the_reflex_and_its_own():
    assert sorted(REFUSALS) == reasons_of_the_reflex()


@pytest.mark.parametrize("reason", REASONS)
def test_what_holds_a_base_is_a_sentence_among_the_limits_too(reason):
    assert limit_words(reason) in passage_words("refused", reason)


@pytest.mark.parametrize("reason", reasons_of_the_reflex())
def test_a_refused_passage_says_why_and_what_to_do(reason):
    assert re.fullmatch(
        r"There is no way through\. [A-Z][^_]+: [^_]+\.", passage_words("refused", reason)
    )


def test_a_protective_stop_comes_before_every_other_reason():
    state = State.model_construct(mode="hold", protective_stop=True, lease_holder="ann")
    assert why(state, None)["next"] == "Clear it, then resume."


def test_an_event_is_one_printable_line_whoever_is_named_in_it():
    event = Event(
        id=1, tick=1, time_s=0.0, severity="warning", name="protective_stop",
        detail="asked by \x1b]0;mine\x07\u202e", values={"by": "\x9b2J"},
    )  # fmt: skip
    assert event_line(event).isprintable()
