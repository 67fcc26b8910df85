"""A page holds a motion as long as it beats; judged in virtual time at the daemon's end."""

import json

import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.topics import Role
from telerobot.tools.operator.web.pages import ALIVE_S, HELD_S, LAPSED_S, Page

STICK = {"cmd/joystick": {"twist": [0.05, 0, 0, 0, 0, 0], "expressed_in": "crf"}}
PERIOD_S = 0.01
CELL = "cell"


class Browser:
    """A page in virtual time: its beats, the console's loop, the daemon's state at 100 Hz."""

    def __init__(self, daemon, make_state, role=Role.OPERATOR):
        self.now_s, self._tick = 10.0, 0
        self._daemon, self._state = daemon, make_state
        self.page = Page("ann", role, CELL, daemon.put, daemon.ask, clock=lambda: self.now_s)
        self.beats = True
        self.held = {}

    def say(self, **message):
        self.page.take(json.dumps(message))

    def send(self, key, **fields):
        self.say(type="send", id=1, key=key, fields=fields)
        return self.told("reply")[-1]

    def told(self, kind):
        messages = []
        while not self.page.outbox.empty():
            messages.append(json.loads(self.page.outbox.get_nowait()))
        return [message for message in messages if message["type"] == kind]

    def hold(self, held):
        self.held = held
        if self.beats:
            self.say(type="beat", n=1, held=held)

    def run(self, seconds):
        for step in range(round(seconds / 0.002)):
            self.now_s += 0.002
            if self.beats and step % (5 if self.held else 50) == 0:
                self.say(type="beat", n=1, held=self.held)
            if step % 5 == 0:
                self._tick += 1
                holder = "ann" if self._daemon.epoch else None
                more = {"mode": self._daemon.mode, "epoch": self._daemon.epoch, "holder": holder}
                self.page.on_state(self._state(self._tick, **more))
            self.page.run(self.now_s)

    def drive(self):
        assert self.send("operator/lease")["ok"]
        assert self.send("operator/mode", action="enable")["ok"]
        self.run(0.05)


@pytest.fixture
def browser(daemon, make_state):
    made = Browser(daemon, make_state)
    made.drive()
    return made


def twists(daemon):
    return [message.twist[0] for message in daemon.of(t.JOYSTICK)]


def test_what_is_held_is_told_at_once_and_at_every_period(browser, daemon):
    browser.hold(STICK)
    assert twists(daemon) == [0.05], "not with the next round, but now"
    browser.run(0.2)
    assert set(twists(daemon)) == {0.05}
    assert len(twists(daemon)) >= 0.2 / PERIOD_S - 2


def test_a_release_is_told_as_zero_at_once_and_goes_on_being_told(browser, daemon):
    browser.hold(STICK)
    browser.run(0.1)
    daemon.heard.clear()
    browser.hold({})
    assert twists(daemon) == [0.0]
    browser.run(0.3)
    assert set(twists(daemon)) == {0.0}
    assert len(twists(daemon)) > 25, "the stream fell silent: the daemon has to find it out"


def test_a_page_that_hangs_stops_within_two_periods_and_50_ms(browser, daemon):
    browser.hold(STICK)
    browser.run(0.1)
    browser.beats, since_s = False, browser.now_s
    while twists(daemon)[-1] != 0.0:
        browser.run(0.002)
    assert browser.now_s - since_s <= HELD_S + PERIOD_S <= 0.05 + 2 * PERIOD_S


def test_a_page_that_hangs_on_loses_its_keepalive(browser, daemon):
    browser.run(0.5)
    before = len(daemon.of(t.KEEPALIVE))
    assert before >= 4
    browser.beats = False
    browser.run(ALIVE_S)
    heard = len(daemon.of(t.KEEPALIVE))
    browser.run(1.0)
    assert len(daemon.of(t.KEEPALIVE)) <= heard + 1


def test_a_page_that_stutters_goes_on_but_one_that_froze_has_to_let_go_first(browser, daemon):
    browser.hold(STICK)
    browser.run(0.1)
    for pause_s, last in ((0.1, 0.05), (LAPSED_S + 0.1, 0.0)):
        browser.beats = False
        browser.run(pause_s)
        assert twists(daemon)[-1] == 0.0
        browser.beats = True
        browser.run(0.05)
        assert twists(daemon)[-1] == last
    assert browser.told("beat")[-1]["lapsed"]
    browser.hold({})
    browser.hold(STICK)
    assert twists(daemon)[-1] == 0.05


def test_a_page_that_goes_stops_and_gives_the_lease_back(browser, daemon):
    browser.hold(STICK)
    browser.page.end()
    assert twists(daemon)[-1] == 0.0
    assert len(daemon.of(t.RELEASE)) == 1


def test_a_mode_in_which_nothing_moves_ends_what_is_held(browser, daemon):
    browser.hold(STICK)
    daemon.mode = "hold"
    browser.run(0.05)
    daemon.heard.clear()
    browser.run(0.2)
    assert twists(daemon) == []


def test_a_jog_at_zero_does_not_keep_the_stick_waiting(browser, daemon):
    browser.hold({"cmd/jog": {"rates": [0.1]}})
    browser.hold({})
    assert daemon.of(t.JOG)[-1].rates == (0.0,)
    daemon.heard.clear()
    browser.hold(STICK)
    browser.run(0.1)
    assert daemon.of(t.JOG) == []
    assert twists(daemon)


def test_an_observers_page_may_stop_and_nothing_else(daemon, make_state):
    watcher = Browser(daemon, make_state, Role.OBSERVER)
    for key in ("operator/lease", "operator/mode", "cmd/cancel"):
        assert watcher.send(key)["reason"] == "not_certified"
    watcher.hold(STICK)
    watcher.run(0.1)
    assert daemon.heard == []
    assert watcher.send("operator/protective_stop")["ok"]
    assert len(daemon.of(t.PROTECTIVE_STOP)) == 1


@pytest.mark.parametrize(
    ("fields", "words"), [({"factor": 7}, "factor"), ({"factor": 0.5, "more": 1}, "more")]
)
def test_what_a_message_does_not_take_is_refused_with_the_field(browser, fields, words):
    reply = browser.send("operator/speed", **fields)
    assert not reply["ok"]
    assert words in reply["words"].lower()


@pytest.mark.parametrize(
    "text",
    ["", "[]", "7", "{", '{"type": "dance"}', '{"type": "beat", "held": 7}',
     '{"type": "beat", "held": {"cmd/joystick": {"twist": "up"}}}',
     '{"type": "beat", "held": {"cmd/joystick": [[1]]}}',
     '{"type": "send", "id": 1, "key": "cmd/joystick", "fields": {}}',
     '{"type": "send", "id": 1, "key": "operator/mode", "fields": [1]}',
     '{"type": "beat", "held": {"cmd/joystick": {"twist": [NaN, 0, 0, 0, 0, 0]}}}',
     "[" * 60000, '{"type": "beat", "n": ' + "9" * 5000 + "}"],
    ids=lambda text: text[:50],
)  # fmt: skip
def test_junk_moves_nothing_and_is_told_so(browser, daemon, text):
    daemon.heard.clear()
    browser.page.take(text)
    assert daemon.heard == []
    assert browser.told("complaint") or not browser.page.outbox.empty() or text


def test_a_page_that_reads_too_slowly_is_let_go_and_costs_no_memory(browser):
    for _ in range(1000):
        browser.page.tell({"type": "event"})
    assert browser.page.dismissed == "reads too slowly"
    assert browser.page.outbox.qsize() <= 256


@pytest.mark.parametrize(
    "text", ["{", '{"type": "beat", "held": {"cmd/joystick": {"twist": "up"}}}']
)
def test_junk_of_a_page_ends_what_it_holds(browser, daemon, text):
    browser.hold(STICK)
    browser.run(0.1)
    browser.page.take(text)
    assert twists(daemon)[-1] == 0.0
    browser.run(0.05)
    assert twists(daemon)[-1] == 0.05, "the next beat is one again"


def test_a_page_that_says_too_much_is_let_go_and_stops(browser, daemon):
    browser.hold(STICK)
    browser.run(2.0)
    assert not browser.page.dismissed, "beats at 100 Hz are not too much"
    for _ in range(1000):
        browser.page.take('{"type": "beat", "held": {}}')
    assert browser.page.dismissed == "says too much"
    assert twists(daemon)[-1] == 0.0
