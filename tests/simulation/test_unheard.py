"""Telemetry that nobody listens to is not sent, and a late listener gets all of it at once."""

from collections import Counter

from telerobot.config.load import load_cell
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.server.telemetry import describe
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.memory_link import MemoryLink
from telerobot.tools.simulation.simulation import Simulation

PERIODICAL = (t.STATE, t.REFLECTION, t.DESCRIPTION)


def test_nobody_is_told_nothing_and_a_late_listener_everything_within_a_fraction_of_a_second(
    monkeypatch,
):
    sent = Counter()
    publish = MemoryLink.publish

    def counted(link, topic, payload):
        sent[topic.key] += len(payload)
        publish(link, topic, payload)

    monkeypatch.setattr(MemoryLink, "publish", counted)
    cell = load_cell("pa10_reflect")
    simulation = Simulation(cell, Script.model_validate({"duration_s": 9.0}))
    simulation.cycle.boot()
    simulation.link.close()  # all who listened are gone

    def steps(seconds):
        sent.clear()
        for _ in range(round(seconds / cell.config.timing.period_s)):
            simulation.step()

    steps(0.5)
    assert [sent[topic.key] for topic in PERIODICAL] == [0, 0, 0]
    heard = {}
    simulation.link.listen(lambda topic, payload: heard.setdefault(topic.key, payload))
    steps(0.02)
    assert {t.STATE.key, t.REFLECTION.key} <= heard.keys()
    steps(0.25)
    assert heard[t.DESCRIPTION.key] == encode(describe(cell))
    simulation.close()
