"""Events on stderr: structured, with levels, and never in the way of a tick."""

import contextlib
import json
import os
import re
import socket

import pytest
from telerobot.server.events import MOST_WAITING, Events, LogLines, is_journals, line_of
from telerobot.server.process import notify

FIELD = re.compile(r'(\S+?)=("(?:[^"\\]|\\.)*"|\S*)(?: |$)')


def parsed(line):
    return {
        key: json.loads(value) if value.startswith('"') else value
        for key, value in FIELD.findall(line)
    }


@pytest.fixture
def pipe():
    reads, writes = (os.fdopen(end, mode) for end, mode in zip(os.pipe(), "rw", strict=True))
    yield reads, writes
    reads.close()
    with contextlib.suppress(BrokenPipeError):
        writes.close()


def logged(pipe, level, journal=False):
    """Return the lines of three events, one of each level."""
    reads, writes = pipe
    log, events = LogLines(writes, level, journal=journal), Events()
    events.taps.append(log.take)
    events.at(7, 0.07)
    events.info("mode", "ready -> enabled", mode="enabled")
    events.warning("limited")
    events.error("fault", 's1 said "no"\n', cause="emcy", code=0x7305, share=0.25, none=None)
    log.close()
    writes.close()
    return reads.read().splitlines()


def test_a_line_holds_level_name_time_and_values(pipe):
    last = logged(pipe, "info")[-1]
    assert parsed(last) == {
        "level": "error", "event": "fault", "t": "0.070", "tick": "7", "detail": 's1 said "no"\n',
        "cause": "emcy", "code": str(0x7305), "share": "0.25", "none": "None",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("level", "count"), [("off", 0), ("error", 1), ("warning", 2), ("info", 3)]
)
def test_the_level_says_which_are_told(pipe, level, count):
    assert len(logged(pipe, level)) == count


def test_journald_is_given_the_levels_of_syslog(pipe):
    assert [line[:3] for line in logged(pipe, "info", journal=True)] == ["<6>", "<4>", "<3>"]


def test_a_reader_that_does_not_read_holds_nothing_up_and_is_told_of_what_it_missed(pipe):
    reads, writes = pipe
    log, events = LogLines(writes, "info", journal=False), Events()
    for number in range(5 * MOST_WAITING):
        events.at(number, float(number))
        events.error("fault", "x" * 500)
        log.take(events.take()[0])
    heard = [reads.readline() for _ in range(MOST_WAITING)]  # as many at least are there to read
    assert all(parsed(line)["event"] == "fault" for line in heard)
    log.notice("there again")
    rest = []
    while (line := reads.readline()) != "telerobot: there again\n":
        rest.append(line)
    log.close()
    left_out = [int(parsed(line)["left_out"]) for line in rest if "left_out=" in line]
    told = len(heard) + sum("event=fault" in line for line in rest)
    assert sum(left_out) + told == 5 * MOST_WAITING


def test_a_reader_that_has_gone_is_no_reason_to_stop(pipe):
    reads, writes = pipe
    log, events = LogLines(writes, "info", journal=False), Events()
    reads.close()
    events.taps.append(log.take)
    events.error("fault", "s1")
    log.close()
    assert [event.name for event in events.take()] == ["fault"]


def test_stderr_is_journalds_if_it_is_the_stream_that_the_environment_names(pipe):
    _, writes = pipe
    stat = os.fstat(writes.fileno())
    named = {"JOURNAL_STREAM": f"{stat.st_dev}:{stat.st_ino}"}
    assert is_journals(writes, named)
    assert not is_journals(writes, {"JOURNAL_STREAM": f"{stat.st_dev}:{stat.st_ino + 1}"})
    assert not is_journals(writes, {})


def test_the_service_manager_hears_that_the_daemon_is_ready(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        notify("READY=1", {"NOTIFY_SOCKET": str(tmp_path / "notify")})
        assert manager.recv(100) == b"READY=1"
    notify("READY=1", {"NOTIFY_SOCKET": str(tmp_path / "notify")})
    notify("READY=1", {})


def test_a_line_stays_one_line_whatever_an_event_says():
    events = Events()
    events.warning("refused", "a\nb\x1b[2J", key="c d", other="e=f", empty="")
    line = line_of(events.take()[0])
    assert "\n" not in line
    assert "\x1b" not in line
    assert parsed(line)["detail"] == "a\nb\x1b[2J"


@pytest.mark.parametrize("text", ["\x1b]0;mine\x07", "\x9b2J x", "\u202eann", "a\nb", "x" * 10_000])
def test_what_others_word_is_one_printable_line_of_a_bounded_length(pipe, text):
    reads, writes = pipe
    log, events = LogLines(writes, "info", journal=False), Events()
    events.taps.append(log.take)
    events.warning("protective_stop", f"asked by {text}", operator=text)
    log.notice(text)
    log.close()
    lines = [reads.readline().removesuffix("\n") for _ in range(2)]
    assert all(line.isprintable() and len(line) < 3000 for line in lines)
    if len(text) < 1000:
        assert parsed(lines[0])["operator"] == text
