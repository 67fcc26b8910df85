"""An operator in a terminal: keys, stick, status, and the console that shows them."""

import math
import os
import re
import select
import shutil
import signal
import sys
import termios
import textwrap
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final, Self

from ...config.errors import printable
from ...protocols import topics as t
from ...protocols.messages import requests
from ...protocols.messages.messages import Frame
from ...protocols.messages.telemetry import State, TaskDescription, TaskState
from ...server.control.spatial import rotation_rpy
from ..client.operator import Operator
from ..client.protocol_client import NoLease, OnReply
from .words import limit_words


# --- Which task the keys lead ---------------------------------------------------------------------
def led(state: State | None, tasks: Sequence[TaskDescription], hand: int) -> dict[str, str]:
    """Return what names the task that the keys lead, where a cell has several `tasks`.

    That is the one at `hand`, or the joint task for which its arm holds a payload with others.
    """
    if len(tasks) < 2:
        return {}
    own = tasks[hand].task
    held = None if state is None else state.of(own).held_by
    return {"task": own if held is None else held}


# --- Stick made of held keys: a twist of the tool, or rates of one joint. Pure --------------------
KEYS: Final[Mapping[str, tuple[str, int, float]]] = {
    "w": ("tool", 0, 1.0), "s": ("tool", 0, -1.0), "u": ("tool", 3, 1.0), "o": ("tool", 3, -1.0),
    "a": ("tool", 1, 1.0), "d": ("tool", 1, -1.0), "i": ("tool", 4, 1.0), "k": ("tool", 4, -1.0),
    "r": ("tool", 2, 1.0), "f": ("tool", 2, -1.0), "j": ("tool", 5, 1.0), "l": ("tool", 5, -1.0),
    "[": ("joint", 0, -1.0), "left": ("joint", 0, -1.0), "down": ("joint", 0, -1.0),
    "]": ("joint", 0, 1.0), "right": ("joint", 0, 1.0), "up": ("joint", 0, 1.0),
    "v": ("drive", 0, 1.0), "b": ("drive", 0, -1.0), ",": ("turn", 0, 1.0), ".": ("turn", 0, -1.0),
    "z": ("spare", 0, 1.0), "Z": ("spare", 0, -1.0),
}  # fmt: skip
"""Key: what it moves while it is held, the axis of a twist (0 to 5), and which way.

An arm in tunnels, or a base, is driven along; a base turns to the left or right; the spare joints
move as the elbow does on its circle.
"""

OTHER: Final = ("", 0, 0.0)  # a key that moves nothing

BASE_PER_TOOL = 2.0  # a base is driven so much faster than the tool [1]

SPEEDS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)  # stick speeds to choose from [m/s]

TURN_PER_METRE = 4.0  # angular stick speed for each linear one [rad/m]

FRAMES = (Frame.CRF, Frame.MRF, Frame.BASE, Frame.WORLD)


def opposites(key: str) -> tuple[str, ...]:
    """Return the keys that move the other way along the same axis."""
    what, axis, sign = KEYS.get(key, OTHER)
    return tuple(k for k, other in KEYS.items() if other == (what, axis, -sign))


def ways(held: Collection[str], what: str) -> list[float]:
    """Return which way each of the keys that are held moves something."""
    return [KEYS[key][2] for key in held if KEYS.get(key, OTHER)[0] == what]


@dataclass
class Stick:
    """Choices of the operator: speed, frame, and one joint or the tool."""

    level: int = 3
    frame: Frame = Frame.CRF
    joint: int | None = None
    """Number of the joint that is jogged, counted from 0; None moves the tool."""

    @property
    def speed(self) -> float:
        """Linear speed of the tool [m/s]."""
        return SPEEDS[self.level]

    @property
    def turn(self) -> float:
        """Angular speed of the tool, or of the jogged joint [rad/s]."""
        return TURN_PER_METRE * self.speed

    def faster(self, steps: int) -> None:
        """Choose a higher speed, or a lower one with negative steps."""
        self.level = min(max(self.level + steps, 0), len(SPEEDS) - 1)

    def next_frame(self) -> None:
        """Use the axes of the next frame."""
        self.frame = FRAMES[(FRAMES.index(self.frame) + 1) % len(FRAMES)]

    def twist(self, held: Collection[str]) -> tuple[float, ...]:
        """Return the twist (6,) [m/s, rad/s] of the keys that are held."""
        twist = [0.0] * 6
        for key in held:
            what, axis, sign = KEYS.get(key, OTHER)
            if what == "tool":
                twist[axis] += sign * (self.speed if axis < 3 else self.turn)
        return tuple(twist)

    def insertion(self, held: Collection[str], most: float) -> float:
        """Return the insertion speed of the keys that are held, at most `most` either way [m/s]."""
        return sum(ways(held, "drive")) * min(self.speed, most)

    def drive(self, held: Collection[str], base: Mapping[str, float]) -> tuple[float, float]:
        """Return at which v [m/s] and ω [rad/s] held keys drive a base, within its own."""
        ahead = min(BASE_PER_TOOL * self.speed, base["speed"])
        turn = min(BASE_PER_TOOL * self.turn, base["angular_speed"])
        return sum(ways(held, "drive")) * ahead, sum(ways(held, "turn")) * turn

    def spare(self, held: Collection[str], most: float) -> float:
        """Return the rate of the spare joints of the keys that are held, at most `most`.

        Of the arm angle as fast as the tool turns [rad/s], or so much of the quickest [1].
        """
        return sum(ways(held, "spare")) * min(self.turn, most)

    def rates(self, held: Collection[str], max_velocity: Sequence[float]) -> tuple[float, ...]:
        """Return joint rates (n,) [rad/s] of the keys that are held, within (n,) bounds."""
        rates = [0.0] * len(max_velocity)
        if self.joint is not None and self.joint < len(rates):
            bound = max_velocity[self.joint]
            rates[self.joint] = sum({*ways(held, "joint")}) * min(self.turn, bound)
        return tuple(rates)


# --- Keys from a terminal: typed keys and held keys. Pure: time is an argument --------------------
#
# A terminal never says that a key was released; it only repeats one that is held: first after a
# delay (250 to 660 ms, as the desktop is set), then some 30 times a second. So a key counts as
# held
#
# - from its first press for `first_s`, which bridges the delay before the first repeat,
# - from every repeat for `REPEAT_S`, which bridges a repeat or two that came late.
#
# `first_s` is learnt: two presses that are followed by a quick third were a press and its first
# repeat, and their distance is this terminal's delay. A terminal repeats the newest key only.
FIRST_S = 0.55
"""Time for which a first press counts as held while the terminal's delay is unknown [s]."""

REPEAT_S = 0.18  # time for which a key counts as held after a repeat [s]

QUICK_S = 0.1  # presses closer than this are repeats, no fingers [s]

DELAYS_S = (0.15, 0.9)  # range of a terminal's delay before the first repeat [s]

MARGIN_S = 0.08  # added to the delay that was learnt [s]

SEQUENCES = {
    "\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left",
    "\x1bOA": "up", "\x1bOB": "down", "\x1bOC": "right", "\x1bOD": "left",
    "\t": "tab", " ": "space", "\x03": "ctrl-c", "\x04": "ctrl-d",
}  # fmt: skip


_KEY: Final = re.compile(r"\x1b(?:O.|\[[^@-~]*[@-~]|(?=[^O\[]))|[^\x1b]", re.DOTALL)
"""A character, or an escape sequence to its end."""


class Decoder:
    """Turns what the terminal sends into key names; unknown sequences are passed over."""

    def __init__(self) -> None:
        self._left = ""

    def keys(self, data: bytes) -> list[str]:
        """Return the keys in `data`; a sequence that is not complete waits for the next call."""
        text, keys, at = self._left + data.decode("utf-8", "replace"), [], 0
        while found := _KEY.match(text, at):
            at, name = found.end(), SEQUENCES.get(found[0], found[0])
            if name.isprintable():
                keys.append(name)
        self._left = text[at:]
        return keys


class HeldKeys:
    """Which keys are held, told from their presses and repeats."""

    def __init__(self) -> None:
        self.first_s = FIRST_S  # time for which a first press counts as held [s]; learnt
        self._until: dict[str, float] = {}
        self._presses: dict[str, deque[float]] = {}

    def press(self, key: str, now_s: float) -> None:
        """Take in a press or a repeat."""
        repeated = self._until.get(key, now_s) > now_s
        self._until[key] = now_s + (REPEAT_S if repeated else self.first_s)
        presses = self._presses.setdefault(key, deque(maxlen=3))
        presses.append(now_s)
        if len(presses) == 3:
            delay = presses[1] - presses[0]
            quick = presses[2] - presses[1] < QUICK_S
            if quick and DELAYS_S[0] < delay < DELAYS_S[1]:
                self.first_s = delay + MARGIN_S

    def held(self, now_s: float) -> set[str]:
        self._until = {key: until for key, until in self._until.items() if until > now_s}
        return set(self._until)

    def release(self, *keys: str) -> None:
        """Count keys as released, all of them when none is named."""
        for key in keys or tuple(self._until):
            self._until.pop(key, None)


# --- Lines of an operator's status: the arm, its motion, its bounds, the link. Pure ---------------
ECHO_SHOWN_S = 1.0  # a round trip older than this is not shown [s]

SHOWN = 1e-4  # smallest share of a twist that is shown [m/s, rad/s]

NAMES = {"joystick": "stick"}  # sources that people call otherwise, here as on the page


def tool_words(pose: Sequence[float]) -> str:
    """Return a pose `[x, y, z, roll, pitch, yaw]` as its place and the tool's z and x axes.

    Axes change smoothly at every attitude; roll and yaw spin where the pitch is 90°.
    """
    x, y, z, *rpy = pose
    R = rotation_rpy(*rpy)
    axes = "  ".join(
        f"{name} {a:+.2f} {b:+.2f} {c:+.2f}" for name, (a, b, c) in (("z", R[:, 2]), ("x", R[:, 0]))
    )
    return f"xyz {x:+.3f} {y:+.3f} {z:+.3f} m  {axes}"


def joint_words(names: Sequence[str], q: Sequence[float], slides: Sequence[bool] = ()) -> str:
    """Return joint angles (n,) [rad] in degrees, and in millimetres those of joints that slide."""
    kinds = (*slides, *[False] * (len(names) - len(slides)))
    return " ".join(
        f"{name} {1e3 * x:+.1f} mm" if slide else f"{name} {math.degrees(x):+.1f}°"
        for name, x, slide in zip(names, q, kinds, strict=False)
    )


def share_words(sources: Mapping[str, Sequence[float]]) -> str:
    """Return which sources move the tool, and how fast each would."""
    said = []
    for source, twist in sources.items():
        v, w = math.hypot(*twist[:3]), math.hypot(*twist[3:])
        parts = [f"{1e3 * v:.0f} mm/s"] * (v > SHOWN) + [f"{math.degrees(w):.1f} °/s"] * (w > SHOWN)
        if parts:
            said.append(f"{NAMES.get(source, source.replace('_', ' '))} {' '.join(parts)}")
    return " + ".join(said)


def arm_lines(
    state: State,
    led: TaskState,
    task: Sequence[str],
    jogged: Sequence[str],
    first: int,
    slides: Sequence[bool] = (),
) -> list[str]:
    """Return the lines of an arm; `jogged` names its joints while they are jogged, else nothing.

    `first` is the place of its first joint among the cell's, `slides` which of them slide.
    """
    where = joint_words(jogged, state.q[first:], slides) if jogged else tool_words(led.pose_mrf)
    head = [state.mode.upper(), *task, where]
    if state.protective_stop:
        head.append("PROTECTIVE STOP")
    lines = [" | ".join(head)]
    if led.wrench_mrf is not None:
        fx, fy, fz, mx, my, mz = led.wrench_mrf
        lines.append(f"f {fx:+.1f} {fy:+.1f} {fz:+.1f} N  m {mx:+.2f} {my:+.2f} {mz:+.2f} N·m")
    moving = share_words(led.sources)
    if moving:
        lines.append(moving)
    lines += [limit_words(name) for name in led.limits]
    return lines


def link_words(state: State, operator: Operator, now_s: float) -> list[str]:
    """Return lease, round trip and speed, each as a few words."""
    holder, trip = state.lease_holder, operator.round_trip
    words = [f"lease {holder or 'free'}{' (you)' if holder and operator.holds_lease else ''}"]
    if trip.seconds is not None and trip.heard_s is not None:
        fresh = now_s - trip.heard_s < ECHO_SHOWN_S
        words.append(f"round trip {1e3 * trip.seconds:3.0f} ms" if fresh else "no echo")
    words.append(f"overruns {state.overruns}")
    if operator.description is not None and operator.description.network == "insecure":
        words.append("INSECURE: anybody may command")
    if state.speed_factor < 1.0:
        words.append(f"speed limit {state.speed_factor:.0%}")
    return words


# --- Keyboard teleoperation: keys to requests and streams, telemetry to lines of text -------------
#
# Nothing here waits. A key sends a request, and its answer is printed when it comes; held keys
# set the streams, which the operator's session sends at 100 Hz.
HELP = """\
 w s  a d  r f   move along x, y, z while held        + -   faster, slower
 u o  i k  j l   turn about x, y, z while held        Tab   axes: crf, mrf, base, world
 1 … 9           choose a joint, [ ] or arrows jog it (a move key goes back to the tool)
 m  enable, or go on after HOLD     h  hold           n     drives off
 x or space      protective stop    c  clear it       R     reset after a fault
 p  ready posture    P or 0  park   t  tare           g     force source on, off
 L  take the lease, or give it back q  quit           ?     this help"""

HANDS, TUNNELS = " y  next arm", " v b  insert, withdraw while held"
ELBOW = " z Z  turn the elbow, or move the spare joints, either way while held: the tool stays"
WHEELS = " v b  drive ahead, back while held, with  , .  turn to the left, right"
"""Where the cell has several arms, spare joints, an arm that goes through tunnels, or wheels."""

STREAMS = (t.JOYSTICK, t.JOG, t.DRIVE, t.SELF_MOTION)

SILENT_S = 0.3  # telemetry older than this is shown as missing [s]


class KeyboardTeleop:
    """One operator at a keyboard; `say` prints a line."""

    def __init__(self, operator: Operator, say: Callable[[str], None]) -> None:
        self.stick = Stick()
        self.hand = 0  # place of the task that the keys lead, among the cell's
        self.held = HeldKeys()
        self.quit = False
        self._operator, self._client, self._say = operator, operator.client, say
        self._goal = False
        self._held_lease = False
        self._moving: set[str] = set()
        self._keys: dict[str, Callable[[], None]] = {
            "m": self._enable,
            "h": lambda: self._mode("hold"),
            "n": lambda: self._mode("disable"),
            "R": lambda: self._mode("reset"),
            "x": self._protective_stop,
            "space": self._protective_stop,
            "c": self._protective_clear,
            "p": lambda: self._posture("ready"),
            "P": lambda: self._posture("park"),
            "0": lambda: self._posture("park"),
            "t": lambda: self._request("tare", t.TARE, **self._mechanism),
            "g": self._toggle_force,
            "L": self._toggle_lease,
            "y": self._change_hands,
            "+": lambda: self.stick.faster(1),
            "=": lambda: self.stick.faster(1),
            "-": lambda: self.stick.faster(-1),
            "_": lambda: self.stick.faster(-1),
            "tab": self._next_frame,
            "q": self._quit,
            "ctrl-d": self._quit,
            "?": self.help,
        }

    # --- keys --------------------------------------------------------------------------------

    def press(self, key: str, now_s: float) -> None:
        """Act on a key. A refusal is printed, never raised."""
        try:
            what = KEYS.get(key, OTHER)[0]
            there = {
                "tool": True,
                "joint": True,
                "drive": self._insertion or self._base,
                "turn": self._base,
                "spare": self._spare,
            }
            if there.get(what):
                self._move(key, now_s)
            elif what == "spare":
                self._say("the arm has no spare joint: its task holds them all")
            elif key in "123456789":
                self._choose_joint(int(key) - 1)
            elif key in self._keys:
                self.held.release()
                self._keys[key]()
        except NoLease:
            self._say("you do not hold the lease: L asks for it")

    def help(self) -> None:
        """Say what the keys do."""
        several = len(self._tasks) > 1
        elbow, wheels = (ELBOW, self._spare), (WHEELS, self._base)
        kinds = ((HANDS, several), elbow, (TUNNELS, self._insertion), wheels)
        for line in (*HELP.splitlines(), *(words for words, there in kinds if there)):
            self._say(line)

    def acquire(self, then: Callable[[], None] | None = None) -> None:
        """Ask for the lease; with it, do something."""

        def answered(reply: requests.Reply) -> None:
            if reply.ok and then is not None:
                then()
            elif reply.ok:
                self._say(f"lease granted to {self._client.name}: m enables the arm, ? helps")
            else:
                self._say(f"no lease: {reply.detail or reply.reason}; watching, L asks again")

        self._client.acquire(answered)

    def run(self, now_s: float) -> None:
        """Set the streams to what is held now."""
        state = self._operator.state
        if self._held_lease and not self._operator.holds_lease:
            self._say("the lease is lost: L asks for it")
        self._held_lease = self._operator.holds_lease
        if state is None or state.mode != "enabled" or not self._operator.holds_lease:
            self.held.release()
            self._moving = set()
            self._goal = False
            for topic in STREAMS:
                self._client.end_stream(topic)
            return
        held = self._moving = self.held.held(now_s)
        if self.stick.joint is None:
            self._client.end_stream(t.JOG)
            frame, twist = self.stick.frame, self.stick.twist(held)
            self._client.stream(t.JOYSTICK, twist=twist, expressed_in=frame, **self._task)
            if self._insertion:
                forward = self.stick.insertion(held, self._insertion["speed"])
                self._client.stream(t.DRIVE, rates=(forward,), **self._mechanism)
            if self._base:
                driven = self.stick.drive(held, self._base)
                self._client.stream(t.DRIVE, rates=driven, **self._mechanism)
            if self._spare:
                rate = self.stick.spare(held, self._spare)
                self._client.stream(t.SELF_MOTION, rate=rate, **self._mechanism)
        else:
            self._client.end_stream(t.JOYSTICK)
            self._client.end_stream(t.DRIVE)
            self._client.end_stream(t.SELF_MOTION)
            rates = self.stick.rates(held, self._max_velocity(len(state.q)))
            self._client.stream(t.JOG, rates=rates, **self._mechanism)

    def _max_velocity(self, joints: int) -> Sequence[float]:
        tasks = self._tasks
        return tasks[self.hand].max_velocity if tasks else [0.0] * joints

    # --- which arm ---------------------------------------------------------------------------

    @property
    def _tasks(self) -> tuple[TaskDescription, ...]:
        """The cell's tasks; none before it has described itself."""
        description = self._operator.description
        return () if description is None else description.each

    @property
    def _task(self) -> dict[str, str]:
        """Name of the task that the keys lead, where the cell has several."""
        return led(self._operator.state, self._tasks, self.hand)

    @property
    def _mechanism(self) -> dict[str, str]:
        return {"mechanism": self._tasks[self.hand].mechanism} if len(self._tasks) > 1 else {}

    @property
    def _insertion(self) -> dict[str, float] | None:
        return self._tasks[self.hand].insertion if self._tasks else None

    @property
    def _base(self) -> dict[str, float] | None:
        return self._tasks[self.hand].base if self._tasks else None

    @property
    def _spare(self) -> float:
        """Greatest rate of the spare joints of the arm that is led; 0 where there are none."""
        told = self._tasks[self.hand].self_motion if self._tasks else None
        return max(told.values()) if told else 0.0

    def _change_hands(self) -> None:
        """Lead the next arm; the one that was led stands."""
        if len(self._tasks) < 2:
            self._say("the cell has one arm" if self._tasks else "no description yet")
            return
        for topic in STREAMS:
            self._client.end_stream(topic)
        self.hand = (self.hand + 1) % len(self._tasks)
        self.stick.joint, self._goal = None, False
        self._say(f"the keys lead {self._task['task']}")

    def _move(self, key: str, now_s: float) -> None:
        state = self._operator.state
        if state is None or state.mode != "enabled":
            self._say("the arm is not enabled: m enables it")
            return
        if KEYS[key][0] != "joint":
            self.stick.joint = None
            if self._goal:
                # A posture in force does not hear the stick.
                self._goal = False
                self._client.command(t.CANCEL, **self._task)
        elif self.stick.joint is None:
            self._say("choose a joint first: 1 … 9")
            return
        self.held.release(*opposites(key))
        self.held.press(key, now_s)

    def _choose_joint(self, joint: int) -> None:
        names = self._tasks[self.hand].joints if self._tasks else ()
        if joint >= len(names):
            self._say(f"the arm has {len(names)} joints" if names else "no description yet")
            return
        self.held.release()
        self.stick.joint = joint
        self._goal = False
        self._say(f"joint {joint + 1}, {names[joint]}: [ ] or arrows move it")

    def _next_frame(self) -> None:
        self.stick.joint = None
        self.stick.next_frame()

    def _posture(self, name: str) -> None:
        self.stick.joint = None
        self._client.end_stream(t.JOG)
        self._client.command(t.POSTURE, posture=name, **self._mechanism)
        self._goal = True
        self._say(f"moving to {name}: any move key ends that")

    def _quit(self) -> None:
        self.quit = True

    # --- requests ----------------------------------------------------------------------------

    def _enable(self) -> None:
        if self._operator.holds_lease:
            self._mode("enable")
        else:
            self.acquire(then=lambda: self._mode("enable"))

    def _toggle_lease(self) -> None:
        # A daemon that was started anew never gave the lease that is still held here.
        state = self._operator.state
        told = state is None or state.lease_holder is not None
        if told and self._operator.holds_lease:
            self._client.release(self._answered("release"))
        else:
            self.acquire()

    def _mode(self, action: str) -> None:
        self._request(action, t.MODE, action=action)

    def _protective_stop(self) -> None:
        self._client.protective_stop(self._answered("protective stop"))

    def _protective_clear(self) -> None:
        self._client.clear_protective_stop(self._answered("clear"))

    def _toggle_force(self) -> None:
        state = self._operator.state
        on = state is None or not state.of(self._task.get("task")).on.get("force", True)
        words = f"force {'on' if on else 'off'}"
        self._request(words, t.SWITCH, source="force", on=on, **self._task)

    def _request(self, what: str, topic: t.Topic, **fields: Any) -> None:
        self._client.request(topic, self._answered(what), **fields)

    def _answered(self, what: str) -> OnReply:
        def answered(reply: requests.Reply) -> None:
            if reply.ok:
                self._say(f"{what}: done")
            else:
                self._say(f"{what}: refused: {reply.reason}: {reply.detail}")

        return answered

    # --- what is seen ------------------------------------------------------------------------

    def lines(self, now_s: float) -> tuple[str, ...]:
        """Return the status: what the arm does and why, and what the operator does."""
        operator, state = self._operator, self._operator.state
        since = operator.state_since_s
        if state is None or since is None:
            return f"no telemetry of {operator.cell} yet from {operator.endpoint}", self._stick()
        if now_s - since > SILENT_S:
            return f"no telemetry for {now_s - since:.1f} s", self._stick()
        led = state.of(self._task.get("task"))
        jogged = self._tasks[self.hand].joints if self.stick.joint is not None else ()
        first = sum(len(task.joints) for task in self._tasks[: self.hand])
        slides = self._tasks[self.hand].slides if jogged else ()
        arm = arm_lines(state, led, tuple(self._task.values()), jogged, first, slides)
        return *arm, " | ".join([self._stick(), *link_words(state, operator, now_s)])

    def _stick(self) -> str:
        stick, held = self.stick, " ".join(sorted(self._moving))
        if stick.joint is not None:
            return f"joint {stick.joint + 1} {stick.turn:.2f} rad/s {held}"
        return f"{stick.frame} {stick.speed:g} m/s {held}"


# --- Terminal of an operator: keys one by one, scrolling lines, a status line below ---------------
#
# Left as it was found, whatever ends the program: leaving the context restores it, and SIGINT,
# SIGTERM and SIGHUP only set `ended`, so that the program leaves in order. What is told after
# that is not shown: a reply may come while the lease is given back.
_HIDE_CURSOR, _SHOW_CURSOR = "\x1b[?25l", "\x1b[?25h"
_CLEAR_BELOW = "\x1b[J"
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def is_terminal() -> bool:
    """Return whether a person sits at both ends: keys can be read and lines redrawn."""
    return sys.stdin.isatty() and sys.stdout.isatty()


class Console:
    """A terminal in raw mode, with a status of a few lines at the bottom; a context manager."""

    def __init__(self) -> None:
        self.ended = False  # True once a signal, or the terminal's end, asks to leave
        self._status: list[str] = []
        self._shown = False
        self._fd = sys.stdin.fileno()

    def __enter__(self) -> Self:
        self._found = termios.tcgetattr(self._fd)
        self._handlers = {number: signal.signal(number, self._on_signal) for number in _SIGNALS}
        raw = termios.tcgetattr(self._fd)
        # No echo and no lines; ^Z and ^S would silence an operator in the middle of a motion.
        raw[0] &= ~(termios.IXON | termios.ICRNL)
        raw[3] &= ~(termios.ECHO | termios.ICANON | termios.IEXTEN)
        raw[6][termios.VSUSP] = b"\x00"
        raw[6][termios.VMIN], raw[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self._fd, termios.TCSADRAIN, raw)
        self._shown = True
        self._write(_HIDE_CURSOR)
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._write(("\n" if self._status else "") + _SHOW_CURSOR)
        finally:
            self._shown = False
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._found)
            for number, handler in self._handlers.items():
                signal.signal(number, handler)

    def read(self, wait_s: float) -> bytes:
        """Return what was typed, waiting for it a while; nothing if nothing was."""
        try:
            ready, _, _ = select.select([self._fd], [], [], wait_s)
            data = os.read(self._fd, 1024) if ready else b""
        except OSError:
            ready, data = [self._fd], b""  # the terminal is gone: the same as its end
        if ready and not data:
            self.ended = True
        return data

    def say(self, line: str) -> None:
        """Print a line above the status, whoever worded it."""
        self._write(self._erase() + printable(line) + "\r\n" + self._draw())

    def show(self, *lines: str) -> None:
        """Redraw the status with these lines, each folded to the terminal's width."""
        erase = self._erase()
        width = max(shutil.get_terminal_size().columns - 1, 20)
        self._status = [part for line in lines for part in textwrap.wrap(printable(line), width)]
        self._write(erase + self._draw())

    def _erase(self) -> str:
        up = len(self._status) - 1
        return "\r" + (f"\x1b[{up}A" if up > 0 else "") + _CLEAR_BELOW

    def _draw(self) -> str:
        return "\r\n".join(self._status)

    def _write(self, text: str) -> None:
        if not self._shown:
            return
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except OSError:
            self.ended = True  # nobody reads any more

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.ended = True
