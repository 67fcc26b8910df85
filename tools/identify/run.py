"""Identification from the first attitude to the estimate: on a daemon, or in virtual time."""

from collections.abc import Callable

import numpy as np

from ...config.load import Cell
from ...server.control.mechanism.model import Mechanism
from ...server.control.spatial import Pose
from ..client.operator import Operator
from ..scripts.player import Phase
from ..scripts.script import Script
from ..simulation.simulation import Simulation
from .attitudes import AttitudeStop
from .estimate import Estimate, NotIdentified, estimate
from .guide import ARRIVE_S, AttitudeMean, Guide
from .subject import Subject

LONGEST_S = 1800.0
"""No identification takes longer [s]."""


def identify(
    operator: Operator,
    stops: list[AttitudeStop],
    say: Callable[[str], None],
    subject: Subject | None = None,
) -> list[AttitudeMean]:
    """Lead a daemon's arm through the stops; needs the lease and an enabled arm.

    Raises `NotIdentified` where it could not go on.
    """
    guide = Guide(operator.client, stops, say, subject)
    operator.on_state = guide.run
    try:
        operator.spin(min(LONGEST_S, ARRIVE_S * len(stops)), lambda: guide.over)
    finally:
        operator.on_state = lambda _state: None
    return _samples(guide)


def identify_simulated(
    cell: Cell,
    stops: list[AttitudeStop],
    say: Callable[[str], None] = lambda _line: None,
    subject: Subject | None = None,
) -> list[AttitudeMean]:
    """Identify a cell's virtual hardware in virtual time. Raises `NotIdentified`."""
    simulation = Simulation(cell, Script(duration_s=LONGEST_S))
    guide = Guide(simulation.player.client, stops, say, subject)

    def after_tick(running: Simulation) -> None:
        if running.player.phase is Phase.PLAYING:
            guide.run(running.states[-1])
            if guide.over:
                running.player.phase = Phase.OVER

    simulation.on_tick = after_tick
    result = simulation.run()
    failure = result.summary["failure"]
    if failure is not None:
        raise NotIdentified(str(failure))
    return _samples(guide)


def judge(cell: Cell, samples: list[AttitudeMean]) -> Estimate:
    """Return what the samples tell. Raises `NotIdentified`."""
    sensor = cell.config.mechanism.force_torque
    if sensor is None:
        raise NotIdentified("the cell has no force/torque sensor")
    mechanism = Mechanism.from_cell(cell)
    nominal = Pose.from_xyz_rpy(sensor.T_wrist_sensor.xyz, sensor.T_wrist_sensor.rpy)
    attitudes = np.array([mechanism.pose_wrist(s.q).R for s in samples]).reshape(-1, 3, 3)
    readings = np.array([s.wrench for s in samples]).reshape(-1, 6)
    return estimate(attitudes, readings, nominal.R)


def _samples(guide: Guide) -> list[AttitudeMean]:
    if guide.failure or not guide.over:
        raise NotIdentified(guide.failure or "it took too long")
    return guide.samples
