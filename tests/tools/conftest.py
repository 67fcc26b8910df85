"""A daemon as an operator sees it: answers requests, notes commands, tells its state."""

from dataclasses import dataclass, field

import pytest
from telerobot.protocols import messages as m
from telerobot.protocols import requests
from telerobot.protocols import topics as t
from telerobot.protocols.codec import decode, encode

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
    return m.State(**fields | more)


@dataclass
class FakeDaemon:
    """Grants everything but what `refusals` names by topic key; enables at once."""

    refusals: dict = field(default_factory=dict)
    heard: list = field(default_factory=list)
    mode: str = "ready"
    epoch: int = 0

    def put(self, topic, payload):
        self.heard.append((topic, decode(topic, payload)))

    def ask(self, topic, payload, answer):
        message = decode(topic, payload)
        self.heard.append((topic, message))
        if topic.key in self.refusals:
            reply = requests.Reply(ok=False, reason=self.refusals[topic.key], detail="by the test")
        elif topic is t.LEASE:
            self.epoch += 1
            reply = requests.Reply(ok=True, token=f"token of {message.operator}", epoch=self.epoch)
        else:
            reply = requests.Reply(ok=True)
            if topic is t.MODE and message.action == "enable":
                self.mode = "enabled"
        answer(encode(reply))

    def of(self, topic):
        """Return what came on a topic."""
        return [message for heard, message in self.heard if heard is topic]


@pytest.fixture
def daemon():
    return FakeDaemon()


@pytest.fixture
def make_state():
    return state
