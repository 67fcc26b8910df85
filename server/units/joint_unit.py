"""A task that several arms hold together: what is commanded for it, and whether it is on."""

from collections.abc import Sequence

import numpy as np

from ...config.load import Cell, grasp_part, joint_part
from ...config.schema.joint_task import JointTaskSection
from ...protocols.messages import messages as m
from ...protocols.messages import motion, requests
from ...protocols.messages.reflection import ReflectionRequest
from ..commands.commands import Commands
from ..commands.settings import CellSettings
from ..control.evolve import evolve
from ..control.frame_tree import Mount
from ..control.grasps.held import Holding
from ..control.spatial import GRAVITY, Array, Pose
from ..control.state import Inputs, Intent, Output
from ..control.task.asked import ViewGoal
from ..mode import Mode
from ..perception.cameras import VisionTracker
from ..perception.contact.jam import JamMonitor
from ..perception.obstacle_map import ObstacleMap
from ..plant import UnitReading
from ..refusals import Refused, Why
from ..runtime.events import Events
from ..stability.gains import LoopBounds
from .stop_ramps import bounded_spread, ramps_together
from .tick_inputs import tick_inputs
from .unit import Unit, mrf_in_force

WEIGHED_ALONE = (requests.PayloadRequest, requests.TareRequest)
"""Requests that need a whole load on the sensor, not an arm's share of one."""

AT_THE_ARM = (
    motion.RedundancyRequest, requests.GripperRequest, requests.AcknowledgeLoad, m.CancelGoals,
)  # fmt: skip
"""Requests that may concern one arm alone while it holds a payload with others."""


class JointUnit:
    """Commands and memory of one joint task; its arms are units with all that is theirs."""

    def __init__(
        self,
        cell: Cell,
        section: JointTaskSection,
        units: Sequence[Unit],
        settings: CellSettings,
        events: Events,
    ) -> None:
        """Build it for a task of a cell, whose `units` hold the payload; the first leads."""
        self.task, self.mechanism, self.units = section.name, "", tuple(units)
        self.events = events.of(section.name)
        part = joint_part(cell, section)
        grasps = [grasp_part(cell, section, i) for i in range(len(section.by))]
        self.commands = Commands.from_cell(part, settings, LoopBounds(part, grasps))
        self.commands.settings.on["following"] = False
        self.arm, self.perception = units[0].arm, units[0].perception
        first = (section.T_wrist_mrf[0].xyz, section.T_wrist_mrf[0].rpy)
        self._T_wrist_payload = Pose.from_xyz_rpy(*first)
        self._sees = next((u for u in units if u.vision.watching), units[0])
        """The arm with the camera whose view is kept."""
        self.commands.frames.lens = self._lens
        self.on = section.at_start
        """The arms hold the payload."""
        self.output: Output | None = None
        """Output of the task in the last tick; None while it is off."""
        self.in_proportion = section.quick_stop == "in_proportion"
        """A quick stop is told the ramps by which all joints come to rest together."""
        self._told = [0] * len(units)
        self.jam = JamMonitor(cell.config.timing.period_s, self.events, carries=True)
        """Whether contact holds up what is asked of the payload."""
        self._payload = section.payload
        sensor = units[0].cell.config.mechanism.force_torque
        self._bounds = (np.inf, np.inf)
        if sensor is not None:
            self._bounds = (sensor.unexplained_force, sensor.unexplained_moment)
        self._load = np.zeros(4)
        """What the payload weighs beyond what was told, as an event told last (4,) [kg, kg·m]."""

    @property
    def T_world_mrf(self) -> Pose | None:
        """Where the command has the shared MRF in force; None while the task is off."""
        return None if self.output is None else mrf_in_force(self.output, self.commands)

    @property
    def vision(self) -> VisionTracker:
        """The view that is kept, as far as known."""
        return self._sees.vision

    def look_through(self, camera: str | None) -> VisionTracker:
        """Return what knows of the view of a camera of any arm, which is the one to keep now.

        Raises `Refused` for a camera that none has; without a name it is the one that is kept.
        """
        if camera is not None:
            held = [u for u in self.units if camera in u.vision.cameras]
            if not held:
                known = ", ".join(name for u in self.units for name in u.vision.cameras) or "none"
                raise Refused(Why.UNKNOWN_CAMERA, f"{camera!r} is none of {known}")
            self._sees = held[0]
        return self.vision

    def _T_first_wrist(self) -> Pose:
        """Return the Wrist of the arm that sees, as the first's has it by the shared payload."""
        memory = self._sees.memory
        if memory is None or memory.held is None:
            return Pose.identity()
        return self._T_wrist_payload @ memory.held.T_wrist_payload.inverse()

    def _lens(self) -> Mount | None:
        lens = self.vision.lens
        if lens is None or lens.on != "wrist":
            return lens
        return lens._replace(T=self._T_first_wrist() @ lens.T)

    def _view(self, view: ViewGoal | None) -> ViewGoal | None:
        """Return where a view is to bring a point that the first Wrist carries."""
        if view is None:
            return None
        return evolve(view, T_wrist_point=self._T_first_wrist() @ view.T_wrist_point)

    @property
    def reason_to_stop(self) -> str | None:
        """Why the arms may not move, or None: they press too hard, or lost the payload."""
        if not self.on or self.output is None:
            return None
        for unit in self.units:
            held = None if unit.output is None else unit.output.held
            if held is not None and held.strained is not None:
                return f"{held.strained.replace('_', ' ')} of {self.task}"
            if held is not None and held.slipped:
                return f"{self.task} slipped from {unit.mechanism}"
        return None

    def require(self, message: m.Message) -> None:
        """Raise `Refused` for what is meant for one arm alone while this is on."""
        if self.on and isinstance(message, WEIGHED_ALONE):
            why = "which it shares with others: let go of it first"
            raise Refused(Why.NOT_NOW, f"the arm's sensor carries '{self.task}', {why}")
        if self.on and not isinstance(message, AT_THE_ARM):
            raise Refused(Why.NOT_NOW, f"the arm holds '{self.task}': command that task, or let go")

    def require_shared(self, message: m.Message) -> None:
        """Raise `Refused` for what a payload in several hands cannot do."""
        match message:
            case requests.SwitchRequest(source="following", on=True):
                asked = True
            case requests.GainRequest(source="following"):
                asked = True
            case _:
                asked = False
        if asked:
            why = "each arm gives way at its own grasp, where a hand's force is one of several"
            raise Refused(Why.NOT_NOW, f"nothing follows a hand on '{self.task}': {why}")
        if isinstance(message, ReflectionRequest):
            raise Refused(Why.NOT_NOW, f"forces on '{self.task}' are not reflected to a handle")

    def inputs(
        self,
        mode: Mode,
        tick: int,
        now_s: float,
        reading: UnitReading,
        q: Array,
        obstacles: ObstacleMap,
    ) -> Inputs:
        """Return the inputs of the first arm, which are the task's, too."""
        first = self.units[0]
        T_world_mrf = self.T_world_mrf or first.T_world_mrf or Pose.identity()
        asked = self.commands.in_force(now_s, T_world_mrf)
        own = first.commands.control_settings()
        settings = evolve(
            asked.settings,
            wrench_bias=own.wrench_bias,
            payload=own.payload,
            objectives=own.objectives,
        )
        asked = asked._replace(settings=settings, jog=None, posture=None)
        moved = first.commands.frames.moved
        inputs = tick_inputs(
            mode, tick, now_s, reading, q, asked, self.perception, obstacles, moved
        )
        if not self.vision.watching or inputs.intent is not Intent.MOVE:
            return inputs
        return evolve(inputs, view=self._view(self.vision.goal(moved.base.T)))

    def stop_ramps(self) -> dict[int, float]:
        """Return the ramps by which all joints of its arms come to rest together [rad/s²].

        By the joints' places in the cell; none before the first tick.
        """
        return ramps_together(self.units, bounded_spread(self.units))

    def keep(self, output: Output | None) -> None:
        """Take in what a tick decided of the task; None while it is off."""
        self.output = output
        self.jam.update(output)
        if output is None:
            return
        if output.held is not None:
            self._tell_load(output.held)
        for i, unit in enumerate(self.units):
            held = None if unit.output is None else unit.output.held
            if held is not None and held.redefined > self._told[i]:
                self.events.info(
                    "grasp_redefined",
                    f"{unit.mechanism} sees the payload elsewhere than it did",
                    mechanism=unit.mechanism,
                    apart_m=round(held.apart, 6),
                )
                self._told[i] = held.redefined

    def _tell_load(self, held: Holding) -> None:
        """Tell that the payload weighs otherwise than it was told, or than was told of it last."""
        load, g = held.load, -float(GRAVITY[2])
        if not load.any():  # drives were off: it is weighed anew
            self._load = load
            return
        off = g * (load - self._load)
        if abs(off[0]) <= self._bounds[0] and np.linalg.norm(off[1:]) <= self._bounds[1]:
            return
        self._load, told = load, self._payload
        mass = told.mass + float(load[0])
        com = (told.mass * np.array(told.com) + load[1:]) / max(mass, 1e-3)
        x, y, z = (round(1e3 * float(c)) for c in com)
        self.events.warning(
            "payload_differs",
            f"the grasps carry {mass:.3g} kg with its centre at {x}, {y}, {z} mm, told are "
            f"{told.mass:g} kg",
            mass_kg=round(mass, 3),
            told_kg=told.mass,
        )


def of_task(joint: Sequence[JointUnit], name: str | None) -> JointUnit:
    """Return the joint task of that name, the only one where none is named. Raises `Refused`."""
    for each in joint:
        if each.task == name or (name is None and len(joint) == 1):
            return each
    if not joint:
        raise Refused(Why.UNKNOWN_TASK, "the cell has no task that several mechanisms hold")
    known = ", ".join(each.task for each in joint)
    raise Refused(Why.UNKNOWN_TASK, f"task {name!r} is none of: {known}")
