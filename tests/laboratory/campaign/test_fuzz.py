"""A seeded sample of the campaign's part `fuzz`, and that its judges see what they are to see."""

import pytest
from laboratory.campaign.fuzz import bus, codec, files, network, wire
from laboratory.campaign.fuzz.inputs.values import Values
from laboratory.campaign.fuzz.outcome import Endurance, Outcome
from laboratory.campaign.part import Selection
from laboratory.campaign.parts import PARTS
from telerobot.protocols import codec as protocol_codec
from telerobot.protocols.topics import TOPICS
from telerobot.server.control.barriers.clearance import CollisionConstraint
from telerobot.tools.soak.cli import Touches

PLAYED = [
    *((codec, seed) for seed in range(2)),
    *((network, seed) for seed in (2, 8, 12)),
    *((bus, seed) for seed in range(3)),
    *((files, seed) for seed in range(3)),
]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("what", "seed"), PLAYED, ids=[f"{m.__name__.rpartition('.')[2]}-{s}" for m, s in PLAYED]
)
def test_wild_input_raises_nothing_breaks_no_bound_and_faults_no_arm(what, seed):
    outcome = what.play(seed)
    assert outcome.inputs.total() > 20
    assert outcome.reasons == []


@pytest.mark.hil
def test_a_stranger_on_the_wire_moves_nobody_who_drives():
    outcome = wire.play(0)
    assert outcome.inputs["messages on the wire"] > 1000
    assert outcome.reasons == []


def test_equal_seeds_draw_equal_inputs_and_the_command_runs_them_all():
    jobs = PARTS["fuzz"].jobs(Selection((), range(3, 5)))
    assert [seed for _, seed in jobs] == [3] * 5 + [4] * 4
    assert [kind for kind, seed in jobs if seed == 3][-1] == "wire"
    first, again, other = (PARTS["fuzz"].play(("codec", seed)) for seed in (3, 3, 4))
    assert first.inputs == again.inputs
    assert first.inputs != other.inputs


def test_every_message_can_be_drawn():
    import random

    values = Values(random.Random(1))
    for topic in TOPICS:
        given = {"seen_tick": 1} if topic.needs_proof else {}
        drawn = [values.message(topic.message, **given) for _ in range(40)]
        assert any(message is not None for message in drawn), topic.key


def test_a_decoder_that_raises_is_found(monkeypatch):
    def careless(*_arguments):
        return {}["v"]

    monkeypatch.setattr(protocol_codec, "_unpack", careless)
    found = codec.play(0)
    assert "raised KeyError: 'v'" in found.reasons[0]
    findings = Endurance([Outcome("codec", 1), found])
    assert not findings.kept
    assert any("laboratory.campaign --only fuzz --seeds 0" in line for line in findings.lines())


def test_a_tick_that_raises_is_found(monkeypatch):
    def careless(*_arguments):
        raise ZeroDivisionError("a gap of zero")

    monkeypatch.setattr(CollisionConstraint, "watch", careless)
    # No touch is an excuse while the operator is an honest one.
    monkeypatch.setattr(Touches, "explain", lambda *_: True)
    scene = next(seed for seed in range(20) if network.cell_of(seed) == "pa10_scene")
    reasons = network.play(scene).reasons
    assert any(reason.startswith("tick_raised at ") for reason in reasons), reasons
