"""All units of a cell, those that several arms hold together among them, and requests to them."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Self

import numpy as np

from ...config.load import Cell, grasp_part, joint_part
from ...config.schema.joint_task import JointTaskSection
from ...protocols.messages import messages as m
from ...protocols.messages import messages as motion
from ...protocols.messages import requests
from ...protocols.messages.messages import (
    CancelGoals,
    MechanismCommand,
    Message,
    ReflectionRequest,
    TaskCommand,
)
from ...protocols.messages.perception import FrameNews, FrameRequest, StoreView
from ..commands.commands import Commands
from ..commands.settings import CellSettings
from ..control.axes import holding
from ..control.bodies.rates import ArmTick
from ..control.compiled import evolve
from ..control.grasps import GraspStatus
from ..control.inputs import Inputs, Intent, ToldTunnel, ViewGoal
from ..control.joint_task.joint_task import HoldRefused, JointTasks
from ..control.scene import Mount
from ..control.spatial import GRAVITY, Array, Motion, Pose
from ..control.state import Memory
from ..control.stop.profile import ramps_in_proportion
from ..control.tick import Control
from ..events import Events
from ..mode import Mode
from ..perception.cameras import EVERY, Law, VisionTracker
from ..perception.contact import JamMonitor
from ..perception.obstacle_map import ObstacleMap
from ..perception.perception import Perception
from ..perception.wrench import NAME as SENSOR
from ..perception.wrench import unchanging
from ..plant import UnitReading
from ..refusals import Refused, Why
from ..stability.judgement import LoopBounds
from ..stability.loads import Carried, SharedLoad
from .unit import Unit, mrf_in_force, tick_inputs

# --- Ramps of a quick stop of joints that mean something only together, by their places in a cell

REFERENCE_LAG = 2
"""A drive follows the command of so many periods ago [1]."""
LEAST_SPREAD = 0.01
"""A drive's speed is known to this at best [rad/s]."""


def ramps_together(units: Sequence[Unit], spread: Array) -> dict[int, float]:
    """Return the ramps by which all joints of some arms come to rest together [rad/s²].

    By the joints' places in the cell; none before the first tick. `spread` (n,) as in
    `ramps_in_proportion`.
    """
    told = [(unit, unit.output) for unit in units if unit.output is not None]
    if len(told) < len(units):
        return {}
    dq = np.concatenate([output.dq for _, output in told])
    drives = [d for unit in units for d in unit.cell.config.mechanism.drives]
    ramps = ramps_in_proportion(dq, np.array([d.quick_stop_deceleration for d in drives]), spread)
    places = [i for unit in units for i in range(unit.joints.start, unit.joints.stop)]
    return dict(zip(places, ramps.tolist(), strict=True))


def bounded_spread(units: Sequence[Unit]) -> Array:
    """Return how far speeds (n,) may be from those last told, by the drives' accelerations."""
    drives = [d for unit in units for d in unit.cell.config.mechanism.drives]
    lag_s = REFERENCE_LAG * units[0].arm.p.period_s
    return lag_s * np.array([d.max_acceleration for d in drives])


def curve_ramps(unit: Unit) -> dict[int, float]:
    """Return the ramps by which an arm stops along its curve, of all its joints; else none.

    Its slow joints matter as much as its fast ones, so that what they may differ by is taken from
    how they accelerate now.
    """
    backbone, commanded = unit.cell.config.mechanism.backbone, unit.commanded
    if backbone is None or backbone.quick_stop == "each" or commanded is None:
        return {}
    lag_s = REFERENCE_LAG * unit.arm.p.period_s
    spread = np.maximum(lag_s * np.abs(commanded.ddq), LEAST_SPREAD)
    return ramps_together((unit,), spread)


# --- A task that several arms hold together: what is commanded for it, and whether it is on -------

WEIGHED_ALONE = (requests.PayloadRequest, requests.TareRequest)
"""Requests that need a whole load on the sensor, not an arm's share of one."""

AT_THE_ARM = (
    motion.RedundancyRequest, requests.GripperRequest, requests.AcknowledgeLoad, m.CancelGoals,
    m.SelfMotion, m.ArmAngle,
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
        parts = [unit.cell for unit in units]
        self._load_judge, self._shares = SharedLoad(section, parts), np.array(section.shares)
        self.arm, self.perception = units[0].arm, units[0].perception
        first = (section.T_wrist_mrf[0].xyz, section.T_wrist_mrf[0].rpy)
        self._T_wrist_payload = Pose.from_xyz_rpy(*first)
        self._sees = next((u for u in units if u.vision.watching), units[0])
        """The arm with the camera whose view is kept."""
        self.commands.frames.lens = self._lens
        self.on = section.at_start
        """The arms hold the payload."""
        self.output: ArmTick | None = None
        """Results of the task in the last tick; None while it is off."""
        self.in_proportion = section.quick_stop == "in_proportion"
        """A quick stop is told the ramps by which all joints come to rest together."""
        self._told = [0] * len(units)
        held = [Pose.from_xyz_rpy(T.xyz, T.rpy).inverse().p for T in section.T_wrist_mrf]
        self.jam = JamMonitor(cell.config.timing.period_s, self.events, np.array(held))
        """Whether contact holds up what is asked of the payload."""
        self._payload = section.payload
        sensor = units[0].cell.config.mechanism.force_torque
        self._bounds = (np.inf, np.inf)
        if sensor is not None:
            self._bounds = (sensor.unexplained_force, sensor.unexplained_moment)
        self._load = np.zeros(4)
        """What the payload weighs beyond what was told, as an event told last (4,) [kg, kg·m]."""
        self._aside = np.zeros(3)
        """And what leads it aside, but is no contact (3,) [N, N·m]."""

    @property
    def T_world_mrf(self) -> Pose | None:
        """Where the command has the shared MRF in force; None while the task is off."""
        return None if self.output is None else mrf_in_force(self.output, self.commands)

    @property
    def grasps(self) -> dict[str, GraspStatus]:
        """What is told of each arm's grasp, by the mechanisms; none while the task is off."""
        found = {u.mechanism: u.output.holding for u in self.units if u.output is not None}
        return {name: held for name, held in found.items() if held is not None}

    def share_out(self, weights: tuple[tuple[float, ...], ...]) -> None:
        """Share the load out by diagonals of W (k, 6), none: by the cell's. Raises `Refused`."""
        settings, names = self.commands.settings, ", ".join(u.mechanism for u in self.units)
        if weights and len(weights) != len(self.units):
            raise Refused(Why.OUT_OF_RANGE, f"weights: {len(weights)} rows, one each: {names}")
        asked = np.array(weights) if weights else self._shares
        now = self._shares if settings.shares is None else settings.shares
        reason = self._load_judge.refusal(asked, now, self._carried())
        if reason is not None:
            raise Refused(Why.OVERLOADED, reason)
        settings.shares = np.array(weights) if weights else None

    def _carried(self) -> Carried:
        """Return the payload as it counts, where the arms are."""
        q = [unit.q for unit in self.units if unit.q is not None]
        held = next(iter(self.grasps.values()), None)
        if held is None or len(q) < len(self.units):
            raise Refused(Why.NOT_NOW, "where the arms are was not heard yet")
        mass = self._payload.mass + float(held.load[0])
        moment = self._payload.mass * np.array(self._payload.com) + held.load[1:]
        T_payload_mrf = self._T_wrist_payload.inverse() @ self.commands.frames.T_wrist_mrf
        return Carried(mass, moment / max(mass, 1e-9), T_payload_mrf, tuple(q))

    @property
    def arm_angle(self) -> None:
        """No angle is the task's: each of its arms has its own."""
        return None

    @property
    def vision(self) -> VisionTracker:
        """The view that is kept, as far as known."""
        return self._sees.vision

    def keep_view(self, camera: str | None, *, again: bool, law: Law | None) -> dict[str, float]:
        """Keep the view of now of a camera of any arm, or its stored one; return it.

        Raises `Refused`, and goes on with the view of before. Without a name: of the same camera.
        """
        sees = self._sees
        if camera is not None:
            held = [u for u in self.units if camera in u.vision.cameras]
            if not held:
                known = ", ".join(name for u in self.units for name in u.vision.cameras) or "none"
                raise Refused(Why.UNKNOWN_CAMERA, f"{camera!r} is none of {known}")
            sees = held[0]
        found = sees.vision.store(camera, again=again, law=law)
        self._sees = sees
        return found

    def _T_first_wrist(self) -> Pose:
        """Return the Wrist of the arm that sees, as the first's has it by the shared payload."""
        memory = self._sees.memory
        if memory is None or memory.held is None:
            return Pose.identity()
        return self._T_wrist_payload @ memory.held.T_wrist_payload.inverse()

    def _lens(self) -> Mount | None:
        lens = self.vision.lens()
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
            held = None if unit.output is None else unit.output.holding
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
        asked = self.commands.in_force(now_s, lambda: T_world_mrf)
        own = first.commands.settings.for_control()
        settings = evolve(
            asked.settings,
            wrench_bias=own.wrench_bias,
            payload=own.payload,
            objectives=own.objectives,
        )
        self_motion = first.commands.self_motion.newest(now_s)
        asked = evolve(asked, settings=settings, jog=None, posture=None, self_motion=self_motion)
        moved = first.commands.frames.moved
        inputs = tick_inputs(asked, mode, tick, reading, q, self.perception, obstacles, moved)
        if not self.vision.watching or inputs.intent is not Intent.MOVE:
            return inputs
        return evolve(inputs, view=self._view(self.vision.goal(moved.base.T)))

    def stop_ramps(self) -> dict[int, float]:
        """Return the ramps by which all joints of its arms come to rest together [rad/s²].

        By the joints' places in the cell; none before the first tick.
        """
        return ramps_together(self.units, bounded_spread(self.units))

    def keep(self, output: ArmTick | None) -> None:
        """Take in what a tick decided of the task; None while it is off."""
        self.output = output
        self.jam.update(output)
        if output is None:
            return
        if output.holding is not None:
            self._tell_load(output.holding)
        for i, unit in enumerate(self.units):
            held = None if unit.output is None else unit.output.holding
            if held is not None and held.redefined > self._told[i]:
                self.events.info(
                    "grasp_redefined",
                    f"{unit.mechanism} sees the payload elsewhere than it did",
                    mechanism=unit.mechanism,
                    apart_m=round(held.apart, 6),
                )
                self._told[i] = held.redefined

    def _tell_load(self, held: GraspStatus) -> None:
        """Tell that the payload weighs otherwise than it was told, or than was told of it last.

        And of what leads it aside, but is no contact.
        """
        if held.aside is not self._aside:
            if held.aside.any():
                x, y, about = held.aside.tolist()
                words, values = unchanging(np.array([x, y, 0.0, 0.0, 0.0, about]), 0.0)
                self.events.warning("force_unchanging", f"{words}, and led the payload", **values)
            self._aside = held.aside
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


# --- All units of a cell: found by the names of task or mechanism, and asked together -------------


class Units:
    """The units of a cell in the order of its joints, and what they share."""

    def __init__(
        self,
        units: Sequence[Unit],
        settings: CellSettings,
        obstacles: ObstacleMap,
        joint: Sequence[JointUnit] = (),
        tasks: JointTasks | None = None,
    ) -> None:
        """Build it of at least one unit; they have one period.

        `joint` are the tasks that several of them hold, `tasks` computes these.
        """
        self.each, self.joint = tuple(units), tuple(joint)
        by = {unit.mechanism: unit for unit in self.each}
        on = [(unit, by.get(unit.cell.config.mechanism.on or "")) for unit in self.each]
        self._carried = [(unit, torso) for unit, torso in on if torso is not None]
        """Arms on a torso, each with that."""
        self._tasks = tasks
        self.memory: Memory | None = None
        """What the next tick begins with; None before the joints were heard, and once it is void.
        """
        self.settings, self.obstacles = settings, obstacles
        self.all: tuple[Unit | JointUnit, ...] = (*self.each, *self.joint)
        """All that may be commanded: arms, and tasks that several of them hold."""

    @classmethod
    def from_cell(cls, cell: Cell, control: Control, events: Events) -> Self:
        """Return the units of a loaded cell; nothing is asked of them yet."""
        settings = CellSettings.from_config(cell.config)
        units = [
            Unit(part, arm, joints, settings, events)
            for part, arm, joints in zip(cell.parts, control.arms, control.parts, strict=True)
        ]
        by = {unit.mechanism: unit for unit in units}
        joint = [
            JointUnit(cell, task, [by[name] for name in task.by], settings, events)
            for task in cell.joint_tasks
        ]
        return cls(units, settings, ObstacleMap.from_cell(cell, events), joint, control.joint)

    # --- which of them is meant ------------------------------------------------------------------

    def of(self, message: Message) -> Unit | JointUnit:
        """Return the unit that a message concerns: the first where it names none.

        That is the joint task that the first arm holds a payload for, if it does; the view to be
        stored is that of whoever has the camera. Raises `Refused` for a name that the cell does not
        have, and for what is meant for one arm alone while it holds a payload with others.
        """
        unit = self.each[0]
        if isinstance(message, TaskCommand):
            for joint in self.joint:
                if joint.task == message.task:
                    if not joint.on:
                        raise Refused(Why.NOT_NOW, f"nobody holds '{joint.task}'")
                    joint.require_shared(message)
                    return joint
            if message.task is not None:
                unit = self._named(message.task, Why.UNKNOWN_TASK, "task")
            else:
                if isinstance(message, StoreView) and message.camera is not None:
                    unit = self.seeing(message.camera)
                held = self.holder_of(unit)
                if held is not None:
                    held.require_shared(message)
                    return held
        elif isinstance(message, MechanismCommand) and message.mechanism is not None:
            unit = self._named(message.mechanism, Why.UNKNOWN_MECHANISM, "mechanism")
        holder = self.holder_of(unit)
        if holder is not None:
            holder.require(message)
        return unit

    def told(self, message: Message) -> tuple[Unit | JointUnit, ...]:
        """Return the units that a command is for: all, for goals that are cancelled without a name.

        Raises `Refused` as `of` does.
        """
        if isinstance(message, CancelGoals) and message.task is None:
            return self.all
        return (self.of(message),)

    def holder_of(self, unit: Unit) -> JointUnit | None:
        """Return the joint task for which an arm holds a payload now, or None."""
        for joint in self.joint:
            if joint.on and unit in joint.units:
                return joint
        return None

    def hold_together(self, name: str | None, on: bool) -> None:
        """Let the arms of a joint task hold its payload, or let go of it. Raises `Refused`."""
        joint = of_task(self.joint, name)
        q = [unit.q for unit in self.each if unit.q is not None]
        if self._tasks is None or self.memory is None or len(q) < len(self.each):
            raise Refused(Why.NOT_NOW, "where the arms are was not heard yet")
        try:
            self.memory = self._tasks.switched(joint.task, on, self.memory, q)
        except HoldRefused as refused:
            raise Refused(Why.NOT_NOW, str(refused)) from None
        for unit, own in zip(self.each, self.memory.arms, strict=True):
            unit.memory = own
        told: list[Unit | JointUnit] = [joint, *joint.units]
        for unit_or_task in told:
            unit_or_task.commands.clear()
        joint.on = on
        joint.keep(None)
        joint.events.info(
            "held_together" if on else "let_go", ", ".join(unit.mechanism for unit in joint.units)
        )

    def refitting(self, message: motion.TunnelRequest) -> Iterator[None]:
        """Fit an arm to a tunnel that it is told, a part of a period in each step; then it holds.

        Raises `Refused` where the arm cannot go through it, or is in a part that would move.
        """
        unit = self.of(message)
        if isinstance(unit, JointUnit):
            raise Refused(Why.UNKNOWN_MECHANISM, f"arms hold '{unit.task}' together: name one")
        told = ToldTunnel(message.pieces, message.open) if message.pieces else None
        try:
            yield from unit.arm.body.refitting(told, partial(self._on_the_way, unit))
        except ValueError as error:
            raise Refused(Why.OUT_OF_RANGE, str(error)) from None
        unit.commands.settings.tunnel = told
        length = sum(piece[0] for piece in message.pieces)
        detail = "" if told else "the cell's"
        unit.events.info("tunnel_set", detail, pieces=len(message.pieces), length=length)

    def _on_the_way(self, unit: Unit) -> list[Array]:
        """Return where an arm's joints are told to be, and where its stop from there ends."""
        if self.memory is None:
            return [] if unit.q is None else [unit.q]
        motion, stop, _ = self.memory.commanded.of(unit.joints)
        return [motion.q, stop.at(stop.to_go_s).q]

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the joint tasks that are on."""
        return tuple(joint.task for joint in self.joint if joint.on)

    def seeing(self, camera: str) -> Unit:
        """Return the unit whose task has a camera. Raises `Refused` for one that nobody has."""
        for unit in self.each:
            if any(c.name == camera for c in unit.cell.config.cameras):
                return unit
        known = ", ".join(c.name for unit in self.each for c in unit.cell.config.cameras) or "none"
        raise Refused(Why.UNKNOWN_CAMERA, f"{camera!r} is none of {known}")

    def take_frame(self, news: FrameNews, tick: int) -> None:
        """Take in where a mechanism's Base was, or the Carrier of all. Raises `Refused`."""
        each = [unit.perception.moving_frames for unit in self.each]
        for_it = [tracker for tracker in each if news.name in tracker.names] or each[:1]
        if news.mechanism is not None:
            named = self._named(news.mechanism, Why.UNKNOWN_MECHANISM, "mechanism")
            base = named.perception.moving_frames
        else:
            base = next((tracker for tracker in each if "base" in tracker.names), each[0])
        for tracker in [base] if news.name == "base" else for_it:
            tracker.take(news, tick, base)

    def ahead(self) -> Perception:
        """Return what looks at the contour ahead. Raises `Refused` in a cell without one."""
        for unit in self.each:
            if unit.perception.passage is not None:
                return unit.perception
        raise Refused(Why.NOT_NOW, "the cell says nothing of a contour")

    def _named(self, name: str, why: Why, kind: str) -> Unit:
        for unit in self.each:
            if getattr(unit, kind) == name:
                return unit
        known = ", ".join(getattr(unit, kind) for unit in self.each)
        raise Refused(why, f"{kind} {name!r} is none of: {known}")

    # --- asked together --------------------------------------------------------------------------

    def clear(self) -> None:
        """Drop every stream and goal: what was commanded before is dead."""
        for unit in self.all:
            unit.commands.clear()

    def forget(self) -> None:
        """Void what was computed: the next tick begins where the joints are."""
        self.memory = None
        for unit in self.each:
            unit.memory = None

    def stand(self, told: Motion, q: Array) -> None:
        """Bring arms on a torso to where that is, by what all joints are `told` and measured at."""
        for unit, torso in self._carried:
            unit.stand_on(torso, told.of(torso.joints), q[torso.joints])

    def look_around(self, tick: int) -> None:
        """Tell which links are in sight lines, by where all arms were measured."""
        if tick % EVERY:
            return
        if not (self.obstacles.lines or any(u.perception.sight_lines.lost for u in self.each)):
            return
        measured = [(u, u.q, u.base_measured) for u in self.each if u.q is not None]
        scene = self.obstacles.scene(tick)
        if scene.carried:
            if len(measured) < len(self.each):
                return
            scene = scene.placed([u.arm.mechanism.pose_wrist(q, base) for u, q, base in measured])
        for unit, q, base in measured:
            unit.perception.sight_lines.update(scene, self.each.index(unit), q, base)

    def keep(self, tick: int, memory: Memory, outputs: Sequence[ArmTick]) -> None:
        """Take in what a tick decided."""
        self.memory = memory
        for unit, own, output in zip(self.each, memory.arms, outputs, strict=True):
            unit.keep(tick, own, output)

    @property
    def at_rest(self) -> bool:
        """True while all arms are told to stand."""
        return all(unit.output is not None and unit.output.at_rest for unit in self.each)

    @property
    def following_error(self) -> Array | None:
        """How far all joints (n,) are behind their commands [rad]; None before the first tick."""
        errors = []
        for unit in self.each:
            if unit.output is None:
                return None
            errors.append(unit.output.error)
        return errors[0] if len(errors) == 1 else np.concatenate(errors)

    @property
    def stop_ramps(self) -> dict[int, float]:
        """Ramps of a quick stop now, of joints that are to come to rest together [rad/s²].

        By the joints' places in the cell: those of an arm on a curve, and of arms that hold a
        payload together.
        """
        found: dict[int, float] = {}
        for unit in self.each:
            found.update(curve_ramps(unit))
        for joint in self.joint:
            if joint.on and joint.in_proportion:
                found.update(joint.stop_ramps())
        return found

    def holding(self, q: Array) -> Array:
        """Return the torques (n,) that hold all joints at rest at q (n,) [N·m]."""
        held = [unit.holding(q[unit.joints]) for unit in self.each]
        return held[0] if len(held) == 1 else np.concatenate(held)

    @property
    def touched(self) -> bool:
        """True while something unseen pushes an arm, which stopped for it."""
        return any(unit.perception.touched for unit in self.each)

    @property
    def missed(self) -> tuple[str, ...]:
        """Sensors that are stale, and without which nothing may move.

        No arm holds a payload with others blind.
        """
        found = []
        for unit in self.each:
            sensor = unit.perception.sensor
            if sensor.stale and (sensor.essential or self.holder_of(unit) is not None):
                found.append(f"{unit.cell.prefix}{SENSOR}")
        return tuple(found)

    @property
    def reason_to_stop(self) -> str | None:
        """Why perception lets the arms not move, or None."""
        if self.missed:
            return "sensor stale"
        avoid = self.settings.avoid
        for unit in self.each:
            frames = unit.perception.moving_frames
            if frames.watching and (frame := frames.disputed) is not None:
                return f"news of {frame} disputed"
        if avoid and self.obstacles.stop is not None:
            return "obstacle stale"
        for unit in self.each:
            if avoid and unit.perception.passage is not None and unit.blind:
                return "scanner silent"
        for unit in self.each:
            base = unit.perception.moving_frames.base
            if avoid and base is not None and base.slipping:
                return "wheels slip"
        for joint in self.joint:
            if (reason := joint.reason_to_stop) is not None:
                return reason
        return "touched" if self.touched else None


# --- Requests that concern one arm or its task: settings, frames, loads, paths, views -------------

_PAST = {"pause": "paused", "resume": "resumed", "abort": "aborted"}


def serve_unit(message: m.Message, unit: Unit | JointUnit) -> None:
    """Do what a request asks of a unit, and tell it by an event. Raises `Refused`."""
    commands, events = unit.commands, unit.events
    settings = commands.settings
    match message:
        case requests.GainRequest():
            _set_gain(message, unit)
        case requests.SwitchRequest():
            settings.require_source(message.source)
            if message.on and message.source == "vision":
                unit.vision.require_view()
            settings.switch(message.source, message.on)
            commands.goals.idle = commands.goals.idle and not message.on
            if message.on and message.source == "position":
                commands.goals.restart_path()
            events.info("source_switched", message.source, on=message.on)
        case FrameRequest():
            T_world_mrf = unit.T_world_mrf
            if T_world_mrf is None:
                raise Refused(Why.NOT_NOW, "where the arm is was not heard yet")
            commands.set_frame(message, T_world_mrf)
            _know_ranks(unit)
            _tell_frame(message, unit)
        case requests.PayloadRequest():
            settings.set_payload(message, unit.perception.weighed)
            if not message.unknown:
                _tell_payload(message.name, unit)
        case requests.GripperRequest():
            settings.set_gripper(message.closed)
            events.info("gripper_closed" if message.closed else "gripper_opened")
        case motion.RedundancyRequest():
            settings.set_objective(message)
            commands.goals.idle = False
            events.info("objective_set", message.objective, gain=message.gain)
        case motion.FreeAxesRequest():
            _free_axes(message, unit)
        case motion.VirtualLinksRequest():
            _link(message, unit)
        case motion.LoadSharesRequest():
            _share_out(message, unit)
        case motion.ClutchRequest():
            commands.set_clutch(message)
            master = commands.master
            events.info(
                "clutch_set",
                "",
                engaged=master.engaged,
                translation=master.translation,
                rotation=master.rotation,
            )
        case ReflectionRequest():
            commands.protect_handle(message.protected)
            tell = events.info if message.protected else events.warning
            tell("reflection_protected" if message.protected else "reflection_unprotected")
        case motion.PathRequest():
            commands.goals.control_path(message)
            events.info("path_" + _PAST[message.action])
        case requests.TareRequest():
            _tare(unit)
        case requests.AcknowledgeLoad():
            settings.hear_of_load("acknowledged")
        case StoreView():
            stored = unit.keep_view(message.camera, again=message.again, law=message.law)
            name = "view_kept" if message.again else "view_stored"
            events.info(name, message.camera or "", **stored, law=unit.vision.law)
        case _:
            raise Refused(Why.NOT_NOW, f"no service for {type(message).__name__}")


def _free_axes(message: motion.FreeAxesRequest, unit: Unit | JointUnit) -> None:
    """Leave axes of the MRF free; raises `Refused` where the body has none to leave."""
    if isinstance(unit, JointUnit):
        raise Refused(Why.NOT_NOW, f"arms hold '{unit.task}' together: in all its axes")
    if unit.arm.body.on_curve:
        raise Refused(Why.NOT_NOW, "the arm follows a curve: no axes are its task's")
    commands = unit.commands
    commands.settings.held = holding(message.axes)
    commands.goals.idle = False
    _know_ranks(unit)
    unit.events.info("axes_freed" if message.axes else "axes_held", ", ".join(message.axes))


def _link(message: motion.VirtualLinksRequest, unit: Unit | JointUnit) -> None:
    """Set the virtual links; raises `Refused` where a tool has none of its own."""
    if isinstance(unit, JointUnit):
        raise Refused(Why.NOT_NOW, f"arms hold '{unit.task}' together: it leaves its path nowhere")
    settings = unit.commands.settings
    settings.set_links(message)
    links = settings.links
    if links is not None:
        unit.events.info(
            "links_set",
            "",
            directions=str([list(direction) for direction in links.directions]),
            axes=links.axes,
            always=links.always,
            stiffness=links.stiffness,
        )


def _share_out(message: motion.LoadSharesRequest, unit: Unit | JointUnit) -> None:
    """Share a payload's load out anew; raises `Refused` where an arm does not bear its part."""
    if isinstance(unit, Unit):
        raise Refused(Why.UNKNOWN_TASK, f"'{unit.task}' is one arm's: it carries all of its load")
    unit.share_out(message.weights)
    rows = dict(zip((u.mechanism for u in unit.units), map(str, message.weights), strict=False))
    unit.events.info("load_shared", "" if rows else "as the cell says", **rows)


def _know_ranks(unit: Unit | JointUnit) -> None:
    """Find the ranks of the task's rows before a tick asks for them."""
    settings = unit.commands.settings.for_control()
    if settings.held is None:
        return
    now = None if unit.output is None else unit.output.task.held
    fading = settings.held if now is None else np.minimum(settings.held, now)
    for held in (settings.held, fading):
        unit.arm.mechanism.held_ranks(held == 1.0, settings.T_wrist_mrf)


def _set_gain(message: requests.GainRequest, unit: Unit | JointUnit) -> None:
    reason = unit.commands.settings.set_gain(message.source, message.gain, message.forced)
    if reason is not None:
        unit.events.warning("gain_forced", reason, source=message.source)
    unit.events.info("gain_set", message.source, gain=str(list(message.gain)))


def _tell_frame(request: FrameRequest, unit: Unit | JointUnit) -> None:
    there = request.relative_to or ("wrist" if request.frame == "mrf" else "world")
    on = {"moves_with": unit.commands.frames.crf.on} if request.frame == "crf" else {}
    unit.events.info("frame_set", request.frame, relative_to=str(there), **on)


def _tell_payload(name: str | None, unit: Unit | JointUnit) -> None:
    payload = unit.commands.settings.payload
    if payload is not None:
        com = str(np.round(payload.com, 4).tolist())
        unit.events.info("payload_set", name or "", mass=payload.mass, com=com)


def _tare(unit: Unit | JointUnit) -> None:
    sensor = unit.perception.sensor
    if sensor.unloaded is None:
        raise Refused(Why.SENSOR_STALE, "force_torque is stale or missing")
    if not sensor.still:
        raise Refused(Why.NOT_NOW, "the arm moves, or is told to")
    unit.commands.settings.tare(sensor.unloaded)
    unit.events.info("tared", "", bias=str(np.round(sensor.unloaded, 3).tolist()))
