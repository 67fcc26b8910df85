from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.messages import messages as m
from telerobot.protocols.messages import requests
from telerobot.protocols.messages.messages import MasterPose
from telerobot.protocols.messages.telemetry import TaskDescription
from telerobot.server.control.spatial import rotation_exp, rotation_rpy
from telerobot.tools.client.operator import Motions, TaskClient
from telerobot.tools.scripts.generators import MasterHandle

ENVELOPE = {"seen_tick": 1}


class Said(Motions):
    """An operator who only says things, and its own client; each must be a sound message."""

    holds_lease = True
    state = SimpleNamespace(
        at_goal=False,
        last_seq={"cmd/position": 3},
        of=lambda task: SimpleNamespace(at_goal=task == "right"),
    )

    def __init__(self):
        self.heard = []
        self.client = SimpleNamespace(
            command=self.hear, stream=self.hear, request=self.answer, seq=3,
            end_stream=lambda topic, named: self.heard.append((topic, named)),
        )  # fmt: skip

    @property
    def _line(self):
        return self

    def hear(self, topic, **fields):
        self.heard.append((topic, topic.message(**ENVELOPE, **fields)))

    def answer(self, topic, on_reply, **fields):
        self.hear(topic, **fields)
        on_reply(requests.Reply(ok=True))

    def _wait(self, send):
        replies = []
        send(replies.append)
        return replies[0]

    def spin(self, seconds=0.0, until=None):
        return until is None or until()


def test_every_word_is_a_sound_message_on_its_topic():
    said = Said()
    said.follow([[0.1, 0, 0, 0, 0, 0.2], [0.2] * 6], [0.1, 0.2], 0.02, "mrf", expressed_in="base")
    said.follow_twists([[0.1, 0, 0, 0, 0, 0]], [2.0], "mrf")
    said.pause_path()
    said.resume_path()
    said.abort_path()
    said.clutch(True)
    said.scale(translation=0.1)
    said.master_pose([0, 0, 0], [0, 0, 0.1], "base")
    said.redundancy("posture", 0.5, "park")
    said.tunnel([[0.3, 1.5, 0, 0.4], [0.2, 0, 0, 0]], open_pieces=1)
    said.load_shares(3, [1, 2, 3, 4, 5, 6])
    topics = [topic for topic, _ in said.heard]
    assert topics == [
        t.PATH, t.PATH, t.PATH_CONTROL, t.PATH_CONTROL, t.PATH_CONTROL, t.CLUTCH, t.CLUTCH,
        t.MASTER_POSE, t.REDUNDANCY, t.TUNNEL, t.LOAD_SHARES,
    ]  # fmt: skip
    words = [message for _, message in said.heard]
    assert words[0].blend == 0.02
    assert words[1].expressed_in is m.Frame.MRF
    assert [w.action for w in words[2:5]] == ["pause", "resume", "abort"]
    assert (words[5].engaged, words[5].translation) == (True, None)
    assert (words[6].engaged, words[6].translation, words[6].rotation) == (None, 0.1, None)
    assert (words[9].pieces[0], words[9].open) == ((0.3, 1.5, 0.0, 0.4), 1)
    assert words[10].weights == ((3.0,) * 6, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0))


def test_what_leads_one_task_names_it_or_its_mechanism():
    said = Said()
    described = TaskDescription.model_construct(task="right", mechanism="arm")
    right = TaskClient(said, described)
    right.joystick([0.1, 0, 0, 0, 0, 0], seconds=1.0)
    right.move_to([0, 0, 0.1], [0, 0, 0])
    right.posture("park")
    right.follow([[0.1] * 6])
    right.clutch(True)
    right.cancel()
    (topic, stick), (ended, named), *others = said.heard
    assert (topic, ended, stick.task, named) == (t.JOYSTICK, t.JOYSTICK, "right", "right")
    assert [message.task for topic, message in others if topic is not t.POSTURE] == ["right"] * 4
    assert others[1][1].mechanism == "arm"
    assert right.wait_goal(1.0)
    assert not said.wait_goal(1.0)


@pytest.mark.parametrize("twist", [(0.1, 0.2, -0.1, 0, 0, 0), (0, 0, 0.1, 0.5, -0.3, 1.0)])
def test_a_masters_handle_moves_as_it_is_told(twist):
    master = MasterHandle()
    master.move((1.0, 0, 0, 0, 0, 2.0), m.Frame.BASE, 5.0)
    master.move(twist, m.Frame.BASE, 5.5)
    pose = MasterPose(**ENVELOPE, **master.fields(7.5))
    p = np.array([0.5, 0.0, 0.0]) + 2.0 * np.array(twist[:3])
    R = rotation_exp(2.0 * np.array(twist[3:])) @ rotation_rpy(0, 0, 1.0)
    np.testing.assert_allclose(pose.xyz, p, atol=1e-12)
    np.testing.assert_allclose(rotation_rpy(*pose.rpy), R, atol=1e-9)
    assert pose.expressed_in is m.Frame.BASE
