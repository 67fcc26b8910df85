"""Telemetry: unsent while nobody listens, all of it for a late listener, equal over the wire."""

from collections import Counter

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.protocols import topics as t
from telerobot.protocols.codec import decode, encode
from telerobot.server.operators.link import MemoryLink
from telerobot.server.telemetry import describe
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

PERIODICAL = (t.STATE, t.REFLECTION, t.DESCRIPTION)


def test_nobody_is_told_nothing_and_a_late_listener_everything_within_a_fraction_of_a_second(
    monkeypatch,
):
    sent = Counter()
    publish = MemoryLink.publish

    def counted(link, topic, message):
        sent[topic.key] += len(encode(message))
        publish(link, topic, message)

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
    simulation.link.listen(lambda topic, message: heard.setdefault(topic.key, message))
    steps(0.02)
    assert {t.STATE.key, t.REFLECTION.key} <= heard.keys()
    steps(0.25)
    assert heard[t.DESCRIPTION.key] == describe(cell)
    simulation.close()


def test_states_come_a_hundred_times_a_second_at_most_however_short_the_period():
    cell = altered(load_cell("planar3"), {"timing.period_s": 0.004})
    simulation = Simulation(cell, Script.model_validate({"duration_s": 9.0}))
    simulation.run(until=lambda: simulation.cycle.tick == 100)
    ticks = [state.tick for state in simulation.states]
    assert len(ticks) == 33
    assert set(np.diff(ticks)) == {3}  # 12 ms: 8 ms would be more often


@pytest.mark.parametrize(
    ("name", "script"),
    [("pa10_all", "all_sources"), ("pa10_pair", "two_nodes"), ("rover", "drive_and_reach"),
     ("snake", "figure_5"), ("pa10_reflect", None)],
)  # fmt: skip
def test_a_message_comes_over_the_wire_as_it_is_handed_over_in_a_simulation(name, script):
    cell = load_cell(name)
    simulation = Simulation(cell, load_script(script or cell.default_script))
    heard = Counter()

    def judge(topic, message):
        heard[topic.key] += 1
        assert decode(topic, encode(message)) == message

    simulation.link.listen(judge)
    simulation.run(until=lambda: simulation.clock.time_s > 2.0)
    assert heard[t.STATE.key] > 50
    assert {t.EVENT.key, t.DESCRIPTION.key} <= heard.keys()
