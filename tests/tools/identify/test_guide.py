import json

import numpy as np
import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages import requests
from telerobot.protocols.messages.telemetry import State
from telerobot.server.identification.payload import AttitudeStop
from telerobot.tools.cli import main
from telerobot.tools.client.operator import Operator, OperatorError
from telerobot.tools.client.protocol_client import ProtocolClient
from telerobot.tools.identify.cli import Guide


class Arm:
    """An arm that is wherever it was told to be, one state later; and its operator's guide."""

    def __init__(self, stops, **state):
        self.sent = []
        self.reply = requests.Reply(ok=True)
        put = lambda topic, payload, proof: self.sent.append(topic)  # noqa: E731
        ask = lambda topic, payload, answer, proof: answer(encode(self.reply))  # noqa: E731
        self.client = ProtocolClient("ann", "cell", put, ask, secret=bytes(32), epoch=1)
        self.guide = Guide(self.client, [AttitudeStop(np.zeros(2), measure) for measure in stops])
        self.state = {"mode": "enabled", "wrench_sensor": (1.0,) * 6, "at_goal": True, **state}
        self.time_s = 0.0

    def go(self, seconds):
        for _ in range(round(100 * seconds)):
            self.time_s += 0.01
            self.guide.run(
                State.model_construct(
                    time_s=self.time_s,
                    q=(0.1, 0.2),
                    gains={"force": (1.0,) * 6},
                    last_seq={t.POSTURE.key: self.client.seq},
                    **self.state,
                )
            )


def test_every_stop_is_gone_to_and_only_those_that_count_are_averaged():
    arm = Arm([True, False, True])
    arm.go(4.0)
    assert arm.guide.over
    assert arm.guide.failure == ""
    assert arm.sent == [t.POSTURE] * 3
    assert len(arm.guide.samples) == 2
    np.testing.assert_allclose(arm.guide.samples[0].wrench, np.ones(6))


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ({"mode": "hold"}, "mode became hold"),
        ({"wrench_sensor": None}, "stale"),
        ({"at_goal": False}, "not reached"),
    ],
)
def test_what_stops_it_is_named(state, words):
    arm = Arm([True], **state)
    arm.go(40.0)
    assert arm.guide.over
    assert words in arm.guide.failure
    assert arm.guide.samples == []


def test_it_does_not_start_while_force_control_cannot_be_switched_off():
    arm = Arm([True])
    arm.reply = requests.Reply(ok=False, reason="no_lease")
    arm.go(1.0)
    assert arm.guide.failure.startswith("no_lease")
    assert arm.sent == []


def test_the_command_tells_what_it_found_and_the_lines_for_the_cell(capsys):
    assert main(["identify", "ur5e", "--simulate", "--json", "--attitudes", "8"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["mass"] == pytest.approx(0.6, rel=0.01)
    np.testing.assert_allclose(told["com"], [0.0, 0.01, 0.05], atol=0.002)
    assert told["mounting_rpy"][2] == pytest.approx(np.pi / 6, abs=0.01)
    assert "payload = { mass = 0.6" in told["toml"] or "payload = { mass = 0.59" in told["toml"]


def test_a_posture_that_the_cell_lacks_is_bad_usage(capsys):
    assert main(["identify", "pa10", "--simulate", "--posture", "nowhere"]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_who_keeps_it_from_the_arm_does_nothing_to_the_terminal(monkeypatch, capsys):
    def held(operator):
        raise OperatorError("lease_held", "by \x1b]0;mine\x07\x9b2J\u202eann")

    monkeypatch.setattr(Operator, "__init__", lambda *_, **__: None)
    monkeypatch.setattr(Operator, "__exit__", lambda *_: None)
    monkeypatch.setattr(Operator, "acquire", held)
    assert main(["identify", "ur5e"]) == 1
    told = capsys.readouterr().err
    assert told.startswith(r"telerobot: not identified: lease_held: by \u001b]0;mine")
    assert told.removesuffix("\n").isprintable()
