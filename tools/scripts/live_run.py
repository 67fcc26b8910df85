"""Plays a script on a running daemon, at wall time; prints events and the final pose."""

import math
import time
from collections.abc import Callable

from ...drivers.network.session import NotCertified
from ...protocols.messages import requests
from ...protocols.messages.telemetry import Event, State
from ...server.control.spatial import Pose, pose_error, sizes
from ..client.operator import POLL_S, Operator
from ..client.protocol_client import ignore
from ..operator.words import event_line
from .player import Phase, Player
from .script import Script

ENABLE_WITHIN_S = 15.0  # a script whose arm is not enabled by then has failed [s]

SILENCE_S = 2.0  # without telemetry for this long, the daemon is taken for gone [s]


class LiveRun:
    """Plays a script over an operator's session; `say` prints a line.

    The script's operators hold leases of their own; the session only carries them.
    """

    def __init__(self, operator: Operator, script: Script, say: Callable[[str], None]) -> None:
        self.player = Player(
            script,
            operator.cell,
            operator.session.put,
            operator.session.ask,
            operator.inject,
            operator.reflection,
        )
        self.failure = ""  # reason for an early end, or empty
        self.events: list[Event] = []
        self._operator, self._say = operator, say

    def run(self) -> int:
        """Play, print events and where the arm ended; return 0 if that is as expected."""
        self.play()
        state = self._operator.state
        for line in self.player.refused:
            self._say(f"refused: {line}")
        if state is not None:
            self._say(ending(state))
        if self.failure:
            self._say(f"not played: {self.failure}")
        if self.failure or state is None:
            return 1
        return 0 if self.player.script.expect.ends_well(state.mode) else 1

    def play(self, end_s: float = math.inf, watch: Callable[[], None] = lambda: None) -> None:
        """Play the script to its end, or until `end_s`, and give back the lease.

        `watch` is called all the while and may raise.
        """
        operator, player = self._operator, self.player
        operators = player.operators
        operator.on_state, operator.on_event = operators.on_state, self._on_event
        operator.on_reflection = operators.on_reflection
        start_s = time.monotonic()
        try:
            while not player.over and not self.failure:
                operator.turn()
                now_s = time.monotonic()
                player.run(now_s)
                self.failure = player.failure or self._trouble(now_s, start_s)
                watch()
                if now_s > end_s:
                    break
                time.sleep(POLL_S)
        except NotCertified as error:
            self.failure = str(error)
        finally:
            operator.on_state = operator.on_event = operator.on_reflection = ignore
            self._release()

    def _trouble(self, now_s: float, start_s: float) -> str:
        silent_s = now_s - (self._operator.state_since_s or start_s)
        if silent_s > SILENCE_S:
            return f"no telemetry for {silent_s:.1f} s"
        if (
            self.player.phase not in (Phase.PLAYING, Phase.OVER)
            and now_s - start_s > ENABLE_WITHIN_S
        ):
            state = self._operator.state
            return f"the arm was not enabled; mode is {state.mode if state else 'unknown'}"
        return ""

    def _release(self) -> None:
        answered: list[requests.Reply] = []
        if self.player.client.secret is not None:
            self.player.client.mute = False
            self.player.client.release(answered.append)
            self.player.run(time.monotonic())
            deadline_s = time.monotonic() + SILENCE_S
            while not answered and time.monotonic() < deadline_s:
                self._operator.session.poll()
                time.sleep(POLL_S)

    def _on_event(self, event: Event) -> None:
        self.events.append(event)
        self._say(event_line(event))


def ending(state: State) -> str:
    """Return the final mode and, with a target, how far the tool is from it."""
    parts = [f"mode {state.mode}", f"at_goal {str(state.at_goal).lower()}"]
    if state.target_mrf is not None:
        for name, pose in (("commanded", state.pose_mrf), ("measured", state.pose_mrf_measured)):
            target, there = (Pose.from_xyz_rpy(p[:3], p[3:]) for p in (state.target_mrf, pose))
            distance, angle = sizes(pose_error(target, there))
            parts.append(f"tool error {name} {1e3 * distance:.3f} mm {1e3 * angle:.3f} mrad")
    return ", ".join(parts)
