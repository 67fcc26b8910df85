"""A demonstration that was recorded, played again by joint positions.

    telerobot record pa10 --seconds 30              # while somebody drives the arm
    telerobot export RUN.mcap --to numpy
    python demonstration.py pa10 RUN.numpy/run.npz

Postures go out 20 times a second, each a goal in place of the last one. Limits, clearances and the
verified stop act as ever: an arm that cannot follow is late or stands, and never goes further.
"""

import argparse
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from telerobot import Operator, OperatorError, SimulatedOperator

RATE: Final = 20.0  # postures a second [1/s]
APPROACH: Final = 4.0
"""The server goes towards a posture at this part of the way left a second [1/s]."""
MOVING: Final = 1e-3  # speed below which a joint stands [rad/s]

Array = NDArray[np.float64]


def postures(file: Path) -> Array:
    """Return a demonstration's postures (k, n) [rad], `RATE` a second, from first motion to last.

    Each is ahead by what the server leaves of the way, so that the arm is where it was shown.

    Raises `ValueError` for a run in which nothing moves.
    """
    run = np.load(file)
    time_s, q, dq = run["time_s"], run["action.q"], run["action.dq"]
    moving = np.flatnonzero(np.abs(dq).max(axis=1) > MOVING)
    if not moving.size:
        raise ValueError(f"{file}: nothing moves in it")
    at_s = np.arange(time_s[moving[0]], time_s[moving[-1]] + 1.0 / RATE, 1.0 / RATE)
    ahead = q + dq / APPROACH
    return np.array([np.interp(at_s, time_s, joint) for joint in ahead.T]).T


def run(operator: Operator, shown: Array) -> None:
    """Go to where a demonstration (k, n) began, and play it. The arm has to be enabled.

    Raises `OperatorError` when it is enabled no longer, the lease is lost or a posture is refused.
    """
    operator.events.clear()
    _send(operator, shown[0])
    if not operator.wait_goal(60.0):
        raise OperatorError("not_now", "the first posture was not reached")
    for i in operator.paced(RATE, len(shown) / RATE):
        _send(operator, shown[i])
    _send(operator, shown[-1])
    operator.wait_goal(5.0)


def _send(operator: Operator, posture: Array) -> None:
    state = operator.wait_state()
    if state.mode != "enabled":
        raise OperatorError("not_now", f"mode is {state.mode}")
    for event in operator.events:
        if event.name == "command_refused":
            raise OperatorError(str(event.values["reason"]), event.detail)
    operator.posture(posture.tolist())


def main() -> None:
    parser = argparse.ArgumentParser(description="Play a recorded demonstration again.")
    parser.add_argument("cell", help="a shipped cell, or the path of yours")
    parser.add_argument("file", type=Path, help="run.npz of `telerobot export --to numpy`")
    parser.add_argument("--simulate", action="store_true", help="simulate the cell here")
    args = parser.parse_args()
    shown = postures(args.file)
    kind = SimulatedOperator if args.simulate else Operator
    with kind(args.cell, name="demonstration") as operator:
        operator.acquire()
        operator.enable()
        run(operator, shown)
        print(f"{len(shown)} postures played")


if __name__ == "__main__":
    main()
