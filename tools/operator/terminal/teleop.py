"""Keyboard teleoperation: keys to requests and streams, telemetry to lines of text.

Nothing here waits. A key sends a request, and its answer is printed when it comes; held keys set
the streams, which the operator's session sends at 100 Hz.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

from ....protocols import topics as t
from ....protocols.messages import requests
from ....protocols.messages.telemetry import TaskDescription
from ...client.operator import Operator
from ...client.protocol_client import NoLease, OnReply
from .hands import led
from .keyboard import HeldKeys
from .status import LinkStatus, arm_lines, link_words
from .stick import AXES, DRIVES, JOINT_SIGNS, TURNS, Stick, opposites

HELP = """\
 w s  a d  r f   move along x, y, z while held        + -   faster, slower
 u o  i k  j l   turn about x, y, z while held        Tab   axes: crf, mrf, base, world
 1 … 9           choose a joint, [ ] or arrows jog it (a move key goes back to the tool)
 m  enable, or go on after HOLD     h  hold           n     drives off
 x or space      protective stop    c  clear it       R     reset after a fault
 p  ready posture    P or 0  park   t  tare           g     force source on, off
 L  take the lease, or give it back q  quit           ?     this help"""

HANDS, TUNNELS = " y  next arm", " v b  insert, withdraw while held"
WHEELS = " v b  drive ahead, back while held, with  , .  turn to the left, right"
"""Where the cell has several arms, where an arm goes through tunnels, and where it has wheels."""

STREAMS = (t.JOYSTICK, t.JOG, t.DRIVE)

SILENT_S = 0.3
"""Telemetry older than this is shown as missing [s]."""


class KeyboardTeleop:
    """One operator at a keyboard; `say` prints a line."""

    def __init__(self, operator: Operator, say: Callable[[str], None]) -> None:
        self.stick = Stick()
        self.hand = 0
        """Place of the task that the keys lead, among the cell's."""
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
            driven = (key in DRIVES and self._insertion) or (
                key in (*DRIVES, *TURNS) and self._base
            )
            if key in AXES or key in JOINT_SIGNS or driven:
                self._move(key, now_s)
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
        kinds = ((HANDS, several), (TUNNELS, self._insertion), (WHEELS, self._base))
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
        else:
            self._client.end_stream(t.JOYSTICK)
            self._client.end_stream(t.DRIVE)
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
        if key in AXES or key in DRIVES or key in TURNS:
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
        led, trip = state.of(self._task.get("task")), operator.round_trip
        jogged = self._tasks[self.hand].joints if self.stick.joint is not None else ()
        first = sum(len(task.joints) for task in self._tasks[: self.hand])
        link = LinkStatus(
            mine=operator.holds_lease,
            round_trip_s=trip.seconds,
            echo_age_s=now_s - (trip.heard_s or -math.inf),
            insecure=operator.description is not None
            and operator.description.network == "insecure",
        )
        arm = arm_lines(state, led, tuple(self._task.values()), jogged, first)
        return *arm, " | ".join([self._stick(), *link_words(state, link)])

    def _stick(self) -> str:
        stick, held = self.stick, " ".join(sorted(self._moving))
        if stick.joint is not None:
            return f"joint {stick.joint + 1} {stick.turn:.2f} rad/s {held}"
        return f"{stick.frame} {stick.speed:g} m/s {held}"
