"""A seeded sample of the campaign's part `fuzz`, and that its judges see what they are to see."""

import contextlib
import subprocess
import sys
from itertools import count, islice, pairwise

import pytest
from hypothesis import strategies as st
from laboratory.campaign import drawn
from laboratory.campaign.fuzz import bus, codec, files, network, wire
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
@pytest.mark.alone
def test_a_stranger_on_the_wire_moves_nobody_who_drives():
    outcome = wire.play(0)
    assert outcome.inputs["messages on the wire"] > 1000
    assert outcome.reasons == []


def test_equal_seeds_draw_equal_inputs_and_the_command_runs_them_all(monkeypatch):
    monkeypatch.setattr(codec, "INPUTS", 100)
    jobs = PARTS["fuzz"].jobs(Selection((), range(3, 5)))
    assert [seed for _, seed in jobs] == [3] * 5 + [4] * 4
    assert [kind for kind, seed in jobs if seed == 3][-1] == "wire"
    first, again, other = (PARTS["fuzz"].play(("codec", seed)) for seed in (3, 3, 4))
    assert first.inputs == again.inputs
    assert first.inputs != other.inputs


def test_every_message_can_be_drawn():
    left = {topic.key for topic in TOPICS}
    for one in islice(drawn.stream(codec.PAYLOADS, "every"), 3000):
        with contextlib.suppress(protocol_codec.CodecError):
            protocol_codec.decode(one.topic, one.payload(1))
            left.discard(one.topic.key)
        if not left:
            break
    assert left == set()


def test_what_fails_is_shrunk_to_its_cause_and_each_time_to_the_same():
    """Of up to a hundred numbers two that are one too far apart, and the second the larger one."""
    judged = []

    def judge(numbers):
        judged.append(numbers)
        return ["fell"] if any(b - a > 500 for a, b in pairwise(numbers)) else []

    numbers = st.lists(st.integers(0, 1000), min_size=1, max_size=100)
    found, again = (drawn.play(numbers, judge, "seven", 50) for _ in range(2))
    assert found == ["fell", "the least: fell; by [0, 501]"]
    assert again == found
    assert judged[: len(judged) // 2] == judged[len(judged) // 2 :]
    assert max(map(len, judged)) > 5


def test_what_is_drawn_depends_on_the_seed_alone_and_not_on_what_was_imported(tmp_path):
    """By its own generator hypothesis draws numbers from the modules that are there."""
    script = (
        "import sys; from itertools import islice; from hypothesis import strategies as st;"
        "from laboratory.campaign import drawn; sys.path.insert(0, sys.argv[1]); {}"
        "print([*islice(drawn.stream(st.integers() | st.floats() | st.binary(), 'x'), 200)])"
    )
    (tmp_path / "many.py").write_text(f"MANY = {[1.5 * n for n in range(1000, 2000)]}")
    outs = [
        subprocess.run(
            [sys.executable, "-c", script.format(first), str(tmp_path)],
            capture_output=True, check=True, text=True,
        ).stdout
        for first in ("", "import many;")
    ]  # fmt: skip
    assert outs[0] == outs[1]


def test_a_decoder_that_raises_is_found(monkeypatch):
    def careless(*_arguments):
        return {}["v"]

    monkeypatch.setattr(protocol_codec, "_unpack", careless)
    found = codec.play(0)
    assert "raised KeyError: 'v'" in found.reasons[0]
    assert found.reasons[-1].endswith("raised KeyError: 'v'; by cmd/keepalive {}")
    findings = Endurance([Outcome("codec", 1), found])
    assert not findings.kept
    assert any("laboratory.campaign --only fuzz --seeds 0" in line for line in findings.lines())


def test_a_tick_that_raises_is_found(monkeypatch):
    def careless(*_arguments):
        raise ZeroDivisionError("a gap of zero")

    monkeypatch.setattr(CollisionConstraint, "watch", careless)
    # No touch is an excuse while the operator is an honest one.
    monkeypatch.setattr(Touches, "explain", lambda *_: True)
    monkeypatch.setattr(drawn, "LEAST", 3)  # more of them take their time
    honest = (seed for seed in count() if seed % 3 != 2)
    scene = next(seed for seed in honest if network.cell_of(seed) == "pa10_scene")
    reasons = network.play(scene).reasons
    assert any(reason.startswith("tick_raised at ") for reason in reasons), reasons
