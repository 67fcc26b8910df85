import json
from itertools import pairwise

import pytest
from telerobot.tools.checks.findings import Severity
from telerobot.tools.cli import main
from telerobot.tools.commands import doctor
from telerobot.tools.host import machine
from telerobot.tools.host.machine import Jitter


class FakeTime:
    """A clock that oversleeps by what it is told, in turn."""

    def __init__(self, oversleep):
        self.time = 100.0
        self.oversleep = list(oversleep)

    def now(self):
        return self.time

    def sleep(self, seconds):
        self.time += seconds + self.oversleep.pop(0)


def test_lateness_is_measured_against_absolute_deadlines():
    clock = FakeTime([0.001, 0.0, 0.004, 0.002])
    jitter = machine.measure_jitter(0.04, 0.01, clock.now, clock.sleep)
    assert jitter.wakeups == 4
    assert jitter.p50 == pytest.approx(0.002)
    assert jitter.max == pytest.approx(0.004)


def test_a_missed_deadline_is_not_slept_for():
    clock = FakeTime([0.025])
    jitter = machine.measure_jitter(0.02, 0.01, clock.now, clock.sleep)
    assert jitter.max == pytest.approx(0.025)


def test_an_unreadable_governor_is_none_and_a_readable_one_its_name(tmp_path):
    assert machine.governor(tmp_path) is None
    (tmp_path / "cpu0/cpufreq").mkdir(parents=True)
    (tmp_path / "cpu0/cpufreq/scaling_governor").write_text("powersave\n")
    assert machine.governor(tmp_path) == "powersave"


def test_frames_cross_the_loopback_bus():
    assert machine.loopback_refusal() == ""


def test_a_bus_that_cannot_be_opened_is_a_refusal_in_words():
    bus = machine._PROBE.model_copy(update={"channel": "not an address"})
    assert "not an address" in machine.loopback_refusal(bus)


def test_the_scheduler_is_left_as_it_was():
    import os

    before = os.sched_getscheduler(0)
    with machine.realtime():
        pass
    assert os.sched_getscheduler(0) == before


@pytest.fixture
def steady(monkeypatch):
    monkeypatch.setattr(machine, "measure_jitter", lambda *_: Jitter(1000, 5e-5, 2e-4, 1e-3))


def status(check):
    return next(f.status for f in doctor.examine() if f.check == check)


def test_a_sound_machine_is_fit_and_json_says_with_which_numbers(steady, capsys):
    assert main(["doctor", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["fit"] is True
    timer = next(f for f in report["findings"] if f["check"] == "timer")
    assert timer["values"]["p99_s"] == 2e-4


def test_what_is_refused_is_a_named_warning_and_still_fit(steady, monkeypatch, capsys):
    monkeypatch.setattr(machine, "memory_lock_refusal", lambda: "Operation not permitted")
    assert main(["doctor"]) == 0
    line = next(x for x in capsys.readouterr().out.splitlines() if "memory lock" in x)
    assert line.startswith("warn")
    assert "Operation not permitted" in line


def test_no_loopback_bus_is_unfit(steady, monkeypatch, capsys):
    monkeypatch.setattr(machine, "loopback_refusal", lambda: "no route")
    assert main(["doctor"]) == 1
    assert capsys.readouterr().out.splitlines()[-1].startswith("not fit for a demo")


def test_a_later_timer_is_judged_worse(monkeypatch):
    found = []
    for p99 in (5e-4, 2e-3, 2e-2):
        monkeypatch.setattr(machine, "measure_jitter", lambda *_, p=p99: Jitter(9, 0.0, p, p))
        found.append(status("timer"))
    order = [Severity.OK, Severity.WARN, Severity.ERROR]
    assert found == order
    assert all(a != b for a, b in pairwise(found))


def test_a_missing_package_is_unfit(steady, monkeypatch):
    monkeypatch.setattr(machine, "requires", lambda _: ["numpy>=2", "no-such-package-here"])
    assert status("packages") is Severity.ERROR


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "soon"])
def test_a_senseless_duration_is_bad_usage(seconds, capsys):
    with pytest.raises(SystemExit) as caught:
        main(["doctor", "--seconds", seconds])
    assert caught.value.code == 2
    assert "--seconds" in capsys.readouterr().err
