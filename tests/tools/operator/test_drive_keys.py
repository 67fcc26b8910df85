import pytest
from telerobot.protocols.messages.messages import Frame
from telerobot.tools.operator.terminal import (
    FIRST_S,
    KEYS,
    REPEAT_S,
    SPEEDS,
    Decoder,
    HeldKeys,
    Stick,
    opposites,
)


class Typist:
    """A key held from 0 to `until_s`; tells at any time whether it counts as held."""

    def __init__(self, until_s, delay_s, keys=None):
        self.keys = keys or HeldKeys()
        repeats = (delay_s + n / 30 for n in range(1000))
        self._presses = [0.0, *(t for t in repeats if t < until_s)]

    def held_at(self, now_s, start_s=0.0):
        while self._presses and self._presses[0] + start_s <= now_s:
            self.keys.press("w", self._presses.pop(0) + start_s)
        return "w" in self.keys.held(now_s)


def test_a_held_key_is_held_without_a_gap_while_the_terminal_waits_to_repeat():
    typist = Typist(until_s=3.0, delay_s=0.5)
    assert all(typist.held_at(ms / 1000) for ms in range(0, 3000, 5))


def test_a_key_is_released_soon_after_its_repeats_stop():
    typist = Typist(until_s=2.0, delay_s=0.5)
    last = max(ms for ms in range(0, 4000, 5) if typist.held_at(ms / 1000))
    assert last / 1000 <= 2.0 + REPEAT_S


def test_a_tap_is_released_by_itself():
    keys = HeldKeys()
    keys.press("w", 0.0)
    assert keys.held(FIRST_S - 0.01) == {"w"}
    assert keys.held(FIRST_S + 0.01) == set()


def test_a_late_repeat_is_bridged():
    keys = HeldKeys()
    for t in (0.0, 0.5, 0.53, 0.66, 0.69):
        keys.press("w", t)
    assert keys.held(0.69 + 0.9 * REPEAT_S) == {"w"}


@pytest.mark.parametrize("delay", [0.25, 0.4, 0.66])
def test_the_terminals_delay_is_learnt_from_the_first_key_that_is_held(delay):
    first = Typist(until_s=2.0, delay_s=delay)
    for ms in range(0, 3000, 5):
        first.held_at(ms / 1000)
    second = Typist(until_s=2.0, delay_s=delay, keys=first.keys)
    assert all(second.held_at(10.0 + ms / 1000, 10.0) for ms in range(0, 2000, 5))
    assert first.keys.first_s == pytest.approx(delay, abs=0.1)


def test_two_taps_teach_nothing_about_the_terminal():
    keys = HeldKeys()
    for t in (0.0, 0.2, 0.4, 0.6, 3.0, 3.3):
        keys.press("w", t)
    assert keys.first_s == FIRST_S


def test_release_names_keys_or_means_all():
    keys = HeldKeys()
    for key in "wad":
        keys.press(key, 0.0)
    keys.release("w")
    assert keys.held(0.1) == {"a", "d"}
    keys.release()
    assert keys.held(0.1) == set()


def test_every_key_has_one_opposite_and_both_together_do_not_move():
    for key in (key for key, (what, _, _) in KEYS.items() if what == "tool"):
        (other,) = opposites(key)
        assert opposites(other) == (key,)
        assert Stick().twist({key, other}) == (0.0,) * 6
    assert opposites("[") == ("]", "right", "up")
    assert (opposites("v"), opposites(","), opposites("Z")) == (("b",), (".",), ("z",))
    assert opposites("h") == ()


def test_keys_are_axes_of_the_twist_at_the_chosen_speed():
    stick = Stick()
    stick.level = SPEEDS.index(0.05)
    assert stick.twist("w") == (0.05, 0, 0, 0, 0, 0)
    assert stick.twist("wf") == (0.05, 0, -0.05, 0, 0, 0)
    assert stick.twist("l") == (0, 0, 0, 0, 0, -0.2)
    assert stick.twist("") == (0,) * 6


def test_speed_stays_on_its_scale():
    stick = Stick()
    for _ in range(20):
        stick.faster(1)
    assert stick.speed == max(SPEEDS)
    for _ in range(20):
        stick.faster(-1)
    assert stick.speed == min(SPEEDS)


def test_frames_go_round():
    stick, seen = Stick(), []
    for _ in range(5):
        seen.append(stick.frame)
        stick.next_frame()
    assert seen == [Frame.CRF, Frame.MRF, Frame.BASE, Frame.WORLD, Frame.CRF]


def test_a_jogged_joint_keeps_its_own_speed_bound():
    stick = Stick(level=len(SPEEDS) - 1, joint=1)
    assert stick.rates({"]"}, (0.5, 0.3, 0.5)) == (0.0, 0.3, 0.0)
    assert stick.rates({"[", "left"}, (2.0, 2.0, 2.0)) == (0.0, -stick.turn, 0.0)
    assert stick.rates(set(), (2.0, 2.0)) == (0.0, 0.0)
    assert Stick(joint=None).rates({"]"}, (2.0,)) == (0.0,)


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"wW", ["w", "W"]),
        (b"\x1b[A\x1b[D\x1bOC", ["up", "left", "right"]),
        (b"\t \x03", ["tab", "space", "ctrl-c"]),
        (b"\x1b[15~w", ["w"]),
        (b"\x1b[1;5Cq", ["q"]),
        (b"\x00\x7f", []),
        (b"\xff", ["�"]),
    ],
)
def test_bytes_become_keys(data, keys):
    assert Decoder().keys(data) == keys


def test_a_sequence_that_comes_in_two_parts_is_one_key():
    decoder = Decoder()
    assert decoder.keys(b"a\x1b") == ["a"]
    assert decoder.keys(b"[") == []
    assert decoder.keys(b"Bb") == ["down", "b"]


def test_keys_drive_a_base_while_others_move_the_tool():
    stick, base = Stick(level=3), {"speed": 0.5, "angular_speed": 0.3}
    held = {"v", ",", "w"}
    assert stick.twist(held) == (SPEEDS[3], 0.0, 0.0, 0.0, 0.0, 0.0)
    assert stick.drive(held, base) == (2 * SPEEDS[3], 0.3)
    assert stick.drive({"b", "."}, base) == (-2 * SPEEDS[3], -0.3)
    assert opposites("v") == ("b",)
    assert opposites(".") == (",",)
    assert Stick(level=len(SPEEDS) - 1).drive({"v"}, base) == (0.4, 0.0)


def test_keys_move_the_spare_joints_within_their_own_bound():
    stick = Stick(level=3)
    assert stick.spare({"z", "w"}, 0.5) == stick.turn
    assert stick.spare({"Z"}, 0.1) == -0.1
    assert stick.spare({"z", "Z"}, 0.5) == 0.0
    assert opposites("z") == ("Z",)
