"""A policy at 20 Hz: it reads the state of the cell and writes a twist of the tool.

    python policy.py pa10 --simulate    # here, in virtual time
    python policy.py pa10               # on the daemon that runs

The twist is a stick's: force control, limits, clearances and the verified stop act as ever. A
policy that hangs loses the stick at once and the lease soon after, and the arm stops.
"""

import argparse
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from telerobot import Operator, OperatorError, SimulatedOperator
from telerobot.protocols.messages.telemetry import State

RATE: Final = 20.0  # decisions a second [1/s]

Array = NDArray[np.float64]
Policy = Callable[[Array], Array]
"""Turns an observation (12,) into a twist (6,) of the tool, in World [m/s, rad/s]."""


def observation(state: State) -> Array:
    """Return what a policy sees: pose of the MRF in World (6,), and the wrench there (6,).

    Pose as x, y, z [m] and roll, pitch, yaw [rad]; the wrench [N, N·m] is zero without a sensor.
    """
    return np.array([*state.pose_mrf_measured, *(state.wrench_mrf or np.zeros(6))])


class ReachPolicy:
    """One layer of a network that leads the tool to a place; learned weights may take its place."""

    GAIN: Final = 1.5  # speed for a distance [1/s]
    FASTEST: Final = 0.05  # fastest motion along each axis [m/s]

    def __init__(self, place: Array) -> None:
        """Build it for a place (3,) [m] in World."""
        self.weights = np.zeros((6, 12))
        self.weights[:3, :3] = -self.GAIN * np.eye(3)
        self.bias = np.concatenate([self.GAIN * place, np.zeros(3)])

    def __call__(self, seen: Array) -> Array:
        """Return the twist for an observation."""
        wanted: Array = self.weights @ seen + self.bias
        return np.asarray(self.FASTEST * np.tanh(wanted / self.FASTEST))


def run(operator: Operator, policy: Policy, seconds: float) -> None:
    """Let a policy lead the tool for a while. The arm has to be enabled.

    Raises `OperatorError` when it is enabled no longer or the lease is lost, `ValueError` for what
    is no twist; the arm then stops.
    """
    for _ in operator.paced(RATE, seconds):
        state = operator.wait_state()
        if state.mode != "enabled":
            raise OperatorError("not_now", f"mode is {state.mode}")
        twist = policy(observation(state))
        # Sent 100 times a second from now on, until the next one.
        operator.joystick(twist.tolist(), expressed_in="world", relative_to="world")
    operator.joystick([0.0] * 6, seconds=0.1)


def main() -> None:
    parser = argparse.ArgumentParser(description="Lead the tool to a place by a policy.")
    parser.add_argument("cell", help="a shipped cell, or the path of yours")
    parser.add_argument("--simulate", action="store_true", help="simulate the cell here")
    args = parser.parse_args()
    kind = SimulatedOperator if args.simulate else Operator
    with kind(args.cell, name="policy") as operator:
        operator.acquire()
        operator.enable()
        start = observation(operator.wait_state())[:3]
        place = start + np.array([0.0, 0.04, 0.06])
        run(operator, ReachPolicy(place), seconds=5.0)
        left = place - observation(operator.wait_state())[:3]
        print(f"{1e3 * np.linalg.norm(left):.1f} mm from the place")


if __name__ == "__main__":
    main()
