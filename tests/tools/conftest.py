"""A daemon as an operator sees it: answers requests, notes commands, tells its state."""

from dataclasses import dataclass, field

import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.codec import decode, encode
from telerobot.protocols.messages import requests
from telerobot.protocols.messages.telemetry import State
from telerobot.protocols.proof import KeyPair, Proof

CELL = "cell"
ZERO = (0.0,) * 6


def state(tick=1, mode="ready", epoch=0, holder=None, **more):
    fields = {
        "tick": tick, "time_s": 0.01 * tick, "mode": mode, "q": (0.0,), "q_command": (0.0,),
        "dq_command": (0.0,), "tau": (0.0,), "following_error": (0.0,), "pose_mrf": ZERO,
        "pose_mrf_measured": ZERO, "pose_crf": ZERO, "target_mrf": None, "wrench_mrf": None,
        "sources": {}, "gains": {},
        "on": {},
        "self_motion": (0.0,),
        "objectives": {},
        "path": None,
        "path_mrf": None,
        "master": {}, "twist": ZERO, "scale": 1.0, "limits": (), "sigma_min": 1.0,
        "at_goal": False, "speed_factor": 1.0, "drives": (), "protective_stop": False,
        "lease_epoch": epoch, "lease_holder": holder, "last_seq": {}, "command_age_ticks": None,
        "overruns": 0,
    }  # fmt: skip
    return State(**fields | more)


@dataclass
class FakeDaemon:
    """Grants everything but what `refusals` names by topic key; enables at once.

    Commands, and requests that need the lease, have to prove it.
    """

    refusals: dict = field(default_factory=dict)
    heard: list = field(default_factory=list)
    mode: str = "ready"
    epoch: int = 0
    secret: bytes = b""
    proofs: list = field(default_factory=list)

    def put(self, topic, payload, attached):
        if topic.needs_proof:
            self.judge(topic, payload, attached)
        self.heard.append((topic, decode(topic, payload)))

    def ask(self, topic, payload, answer, attached):
        message = decode(topic, payload)
        if topic.needs_proof or attached:
            self.judge(topic, payload, attached)
        self.heard.append((topic, message))
        if topic.key in self.refusals:
            reply = requests.Reply(ok=False, reason=self.refusals[topic.key], detail="by the test")
        elif topic is t.LEASE:
            self.epoch += 1
            pair = KeyPair(bytes([self.epoch]) * 32)
            self.secret = pair.agree_with_operator(message.key, t.LEASE.full_key(CELL), self.epoch)
            reply = requests.Reply(ok=True, key=pair.public, epoch=self.epoch)
        else:
            reply = requests.Reply(ok=True)
            if topic is t.MODE and message.action == "enable":
                self.mode = "enabled"
        answer(encode(reply))

    def judge(self, topic, payload, attached):
        proof = Proof.read(attached)
        assert proof.epoch == self.epoch
        assert proof.holds(self.secret, topic.full_key(CELL), payload)
        self.proofs.append((topic, proof))

    def numbers(self, topic):
        """Return the sequence numbers that came on a topic."""
        return [proof.seq for heard, proof in self.proofs if heard is topic]

    def of(self, topic):
        """Return what came on a topic."""
        return [message for heard, message in self.heard if heard is topic]


@pytest.fixture
def daemon():
    return FakeDaemon()


@pytest.fixture
def make_state():
    return state
