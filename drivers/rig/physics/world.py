"""The physics: arms from their URDFs, tool balls, a sprung wall, fixed boxes, in MuJoCo.

The same URDF gives Pinocchio the same mass matrix and gravity; what the rig adds (rotor inertia,
friction, payload) comes from the cell's `[rig]`. Quantities are SI, in World unless said
otherwise; joint vectors are (n,) in the order of the cell's drives, arm after arm.
"""

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell
from ....config.schema.rig import RigGripperSection
from ....config.schema.section import PoseSection
from .beam import Beam
from .bodies import place
from .brakes import Brakes
from .clearance import WorldDistances
from .contacts import Contacts
from .geoms import quaternion
from .movers import TYRE
from .scene import HELD, PLATFORM, POINT_INERTIA, WALL_SLIDE, build_model, prefixes

Vector = NDArray[np.float64]


class _Arm(NamedTuple):
    """Where one arm is in the model: ids of its bodies and site, and where its sensor writes."""

    root: int
    tip: int
    mrf: int
    force: int
    torque: int
    held: RigGripperSection
    prefix: str


class World:
    """The model and its state. Joints start braked at the posture `start`, at rest.

    Where something is asked of an arm, `arm` is its place among the cell's mechanisms.
    """

    def __init__(self, cell: Cell) -> None:
        if cell.config.rig is None:
            raise ValueError(f"cell {cell.config.name} has no [rig]: nothing to simulate")
        self.model, self._fixed = build_model(cell)
        self.data = mujoco.MjData(self.model)
        self.dt = float(self.model.opt.timestep)
        joints = [self.model.joint(name) for name in cell.joints]
        self.n, self._names = len(joints), cell.joints
        self.rolls = cell.config.mechanism.base is not None
        """The arm stands on a base that drives."""
        on_platform = cell.config.frames.base is not None and not self.rolls
        self._first = len(PLATFORM) if on_platform or self.rolls else 0
        if [j.dofadr[0] for j in joints] != list(range(self._first, self._first + self.n)):
            raise ValueError("the cell's drives must stand in the order of the chain's joints")
        self._bodies = [int(j.bodyid[0]) for j in joints]
        self._arms = tuple(
            self._arm(part, prefix) for part, prefix in zip(cell.parts, prefixes(cell), strict=True)
        )
        arm = slice(self._first, self._first + self.n)
        behind = [
            (len(p.config.mechanism.drives), p.config.rig.drive) for p in cell.parts if p.config.rig
        ]
        self.q: Vector = self.data.qpos[self._first + self.rolls :][: self.n]
        self.dq: Vector = self.data.qvel[arm]
        self._ctrl: Vector = self.data.ctrl
        self.brakes = Brakes(self.model, self.data, cell.joints, self._first, self.q, behind)
        """Brakes, jams and friction, which keep joints from moving."""
        self.ahead_s = 0.0
        """How far the bus' time is ahead of the state [s]: a SYNC comes between two steps."""
        self._carried: dict[tuple[int, bool], tuple[float, Vector, Vector]] = {}
        """When an inertial unit was asked last [s], how it moved then [m/s], and its axes."""
        self._pushes: dict[int, Vector] = {}
        self._swells: dict[int, tuple[float, float]] = {}
        """When the push on a tool began, and how long it takes [s], by the tip's body."""
        roots = [arm.root for arm in self._arms]
        self.distances = WorldDistances(self.model, self.data, self._fixed, roots)
        """Of arms from what stands around them, and from each other."""
        self.q[:] = [q for part in cell.parts for q in part.config.mechanism.postures["start"]]
        self.brakes.lock()
        self.beam: Beam | None = None
        """The payload that the arms of a joint task hold; None where they hold nothing."""
        if cell.config.rig.beam is not None:
            self.beam = Beam(self.model, self.data, cell)
            self.beam.grasp()
            roots = [*roots, self.beam.body]
        steps = round(cell.config.timing.period_s / self.dt)
        self._grip = self.model.geom_friction[:, 0].copy()
        """Friction of all geoms at the start [1]."""
        self.contacts = Contacts(self.model, self.data, self._fixed, roots, steps)
        """Of the arms, in the cell's order, and of the payload after them."""
        mujoco.mj_forward(self.model, self.data)

    def _arm(self, part: Cell, prefix: str) -> _Arm:
        model, mechanism = self.model, part.config.mechanism
        tip = int(model.body(prefix + mechanism.tip_link).id)
        if part.config.rig is None:
            raise ValueError(f"cell {part.config.name} has no [rig]: nothing to simulate")
        kinds = (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE)
        force, torque = (int(model.sensor(prefix + k.name.lower()).adr[0]) for k in kinds)
        root = tip
        while (parent := int(model.body_parentid[root])) and model.body(parent).name.startswith(
            prefix
        ):
            root = parent
        return _Arm(
            root,
            tip,
            int(model.site(f"{prefix}mrf").id),
            force,
            torque,
            part.config.rig.gripper,
            prefix,
        )

    @property
    def time_s(self) -> float:
        """Physics time since the start [s]."""
        return float(self.data.time)

    def step(self, torque: Vector) -> None:
        """Advance by one physics step under joint torques (n,) [N·m]."""
        self.brakes.step()
        self._ctrl[:] = torque
        if self.beam is not None:
            self.beam.clear()
        for body, force in self._pushes.items():
            self._apply_push(body, force)
        if self.beam is None:
            mujoco.mj_step(self.model, self.data)
        else:
            mujoco.mj_step1(self.model, self.data)
            self.beam.pull()
            mujoco.mj_step2(self.model, self.data)
        self.contacts.note()

    # --- what holds and pushes the arm --------------------------------------------------------

    def set_brake(self, joint: int, *, closed: bool) -> None:
        """Close or open the holding brake of a joint; one that has closed holds it where it is."""
        self.brakes.set(joint, closed=closed)

    def set_jam(self, joint: int, *, jammed: bool) -> None:
        """Block a joint mechanically where it is, or free it."""
        self.brakes.jam(joint, jammed=jammed)

    def set_extra_friction(self, joint: int, torque: float) -> None:
        """Add Coulomb friction [N·m] to a joint's own; 0 takes it back."""
        self.brakes.stick(joint, torque)

    def set_grip(self, joint: int, friction: float | None = None) -> None:
        """Change how a wheel, and what follows it, grips the floor: their friction [1].

        None: as at the start. Raises `ValueError` for another joint.
        """
        first = self.model.joint(self._names[joint]).name + TYRE
        tyres = [g for g in range(self.model.ngeom) if self.model.geom(g).name.startswith(first)]
        if not tyres:
            raise ValueError(f"fault slip: {self._names[joint]} is no wheel")
        self.model.geom_friction[tyres, 0] = self._grip[tyres] if friction is None else friction

    def grasp(self, closed: bool, arm: int = 0) -> None:
        """Take hold of an arm's object, where it is, or let go of it."""
        what, prefix = self._arms[arm].held, self._arms[arm].prefix
        held, mass = self.model.body(prefix + HELD), what.mass if closed else 0.0
        held.mass[:], held.inertia[:] = mass, POINT_INERTIA * mass
        held.ipos[:] = what.com

    def push_joint(self, joint: int, force: Vector | None) -> None:
        """Push a joint's link at its centre of mass with a World force (3,) [N]; None: let go."""
        self._push(self._bodies[joint], force)

    def push_tool(
        self, force: Vector | None, duration_s: float | None = None, arm: int = 0
    ) -> None:
        """Push a tool at the MRF with a World force (3,) [N]; None: let go.

        With a duration T the push comes and goes as `force · sin²(π t / T)`, as a hand's does.
        """
        tip = self._arms[arm].tip
        self._push(tip, force)
        self._swells.pop(tip, None)
        if force is not None and duration_s is not None:
            self._swells[tip] = self.time_s, duration_s

    def _push(self, body: int, force: Vector | None) -> None:
        if force is None:
            self._pushes.pop(body, None)
            self.data.xfrc_applied[body] = 0.0
        else:
            self._pushes[body] = np.asarray(force, dtype=float)

    def _swollen(self, tip: int) -> float:
        """Return how much of the push on a tool there is now, 0 to 1."""
        if tip not in self._swells:
            return 1.0
        since_s, duration_s = self._swells[tip]
        elapsed_s = self.time_s - since_s
        return math.sin(math.pi * elapsed_s / duration_s) ** 2 if elapsed_s < duration_s else 0.0

    def _apply_push(self, body: int, force: Vector) -> None:
        mrf = next((arm.mrf for arm in self._arms if arm.tip == body), None)
        if mrf is not None:
            force = self._swollen(body) * force
        self.data.xfrc_applied[body, :3] = force
        if mrf is not None:
            lever = self.data.site_xpos[mrf] - self.data.xipos[body]
            self.data.xfrc_applied[body, 3:] = np.cross(lever, force)

    def place_platform(self, place: Vector) -> None:
        """Bring what the arm stands on to a displacement (6,) from its place at start [m, rad].

        Translation in World, then turns about its own x, y, z.
        """
        for name, value in zip(PLATFORM, place.tolist(), strict=True):
            self.model.eq_data[self.model.equality(name).id, 0] = value

    # --- what can be measured -----------------------------------------------------------------

    def sensor_wrench(self, arm: int = 0) -> Vector:
        """Return the load on a force/torque sensor (6,) [N, N·m], in the Sensor frame.

        Everything outboard of the sensor pulls and pushes on it: at rest in free space it reads
        the weight of the payload. MuJoCo reports what the inboard side exerts on the outboard
        one, the opposite.
        """
        data, (force, torque) = self.data.sensordata, self._arms[arm][3:5]
        if torque == force + 3:
            load: Vector = -data[force : force + 6]
            return load
        return -np.concatenate([data[force : force + 3], data[torque : torque + 3]])

    def mrf_pose(self, arm: int = 0) -> tuple[Vector, Vector]:
        """Return an MRF's origin (3,) [m] and rotation matrix (3, 3) in World."""
        mujoco.mj_kinematics(self.model, self.data)
        mrf = self._arms[arm].mrf
        return self.data.site_xpos[mrf].copy(), self.data.site_xmat[mrf].reshape(3, 3).copy()

    def base_pose(self) -> tuple[Vector, Vector]:
        """Return Base's origin (3,) [m] and rotation matrix (3, 3) in World."""
        mujoco.mj_kinematics(self.model, self.data)
        return (
            self.data.xpos[self._arms[0].root].copy(),
            self.data.xmat[self._arms[0].root].reshape(3, 3).copy(),
        )

    def base_twist(self) -> Vector:
        """Return Base's twist (6,) `[v; ω]` at its origin, in World axes."""
        found = np.zeros(6)
        body = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_objectVelocity(self.model, self.data, body, self._arms[0].root, found, 0)
        return np.concatenate([found[3:], found[:3]])

    def inertial(self, arm: int, on_base: bool, at: PoseSection) -> tuple[Vector, Vector]:
        """Return the specific force (3,) [m/s²] and the angular rate (3,) [rad/s] of a place.

        As an accelerometer and a gyroscope have them, in the axes of a frame that is `at` a pose in
        Base, or in an arm's tip link. The force is the mean since it was last asked for, as that of
        a unit which filters what it samples: drives follow their setpoints unevenly within a
        period. At first it is that at rest.
        """
        found, R, p = np.zeros(6), np.zeros(9), np.array(at.xyz)
        body = self._arms[arm].root if on_base else self._arms[arm].tip
        kind = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_objectVelocity(self.model, self.data, kind, body, found, 0)
        mujoco.mju_quat2Mat(R, np.array(quaternion(at)))
        link = self.data.xmat[body].reshape(3, 3)
        axes, turned = link @ R.reshape(3, 3), found[:3]
        moved = found[3:] + np.cross(turned, link @ p)
        then_s, before, axes_before = self._carried.get((arm, on_base), (-1.0, moved, axes))
        self._carried[arm, on_base] = self.time_s, moved, axes
        felt = (moved - before) / max(self.time_s - then_s, self.dt) - self.model.opt.gravity
        return 0.5 * (axes + axes_before).T @ felt, axes.T @ turned

    def place(self, obstacle: str, xyz: Vector) -> None:
        """Move an obstacle of the cell to a place in World [m]. Raises `ValueError`."""
        place(self.model, self.data, obstacle, xyz)

    def wall_travel(self) -> float:
        """Return how far the wall is pushed in, against its normal [m]. Raises `KeyError`."""
        return -float(self.data.joint(WALL_SLIDE).qpos[0])
