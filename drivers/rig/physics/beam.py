"""A payload that several arms hold: a box on sprung pads, with pegs, and the truth about it."""

import math
from typing import Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell
from ....config.schema.rig import RigBeamSection, RigHoleSection
from ....config.schema.section import PoseSection
from ....server.control.compiled import ARRAY3, INDEX, MATRIX, TABLE, VECTOR, compiled, record
from .bodies import make_peg
from .geoms import FIXED, SOLIMP, SOLREF, quaternion

# --- Springs of the pads between the last links of arms and the payload that they hold ------------

Vector = NDArray[np.float64]


@compiled(
    record(TABLE, TABLE, TABLE), INDEX, MATRIX, record(MATRIX, ARRAY3),
    record(MATRIX, ARRAY3, VECTOR), VECTOR, TABLE, TABLE, TABLE,
)  # fmt: skip
def pull_pads(
    places: tuple[Vector, Vector, Vector],
    bodies: NDArray[np.int64],
    twists: Vector,
    tips: tuple[Vector, Vector],
    pads: tuple[Vector, Vector, Vector],
    gains: Vector,
    wrenches: Vector,
    apart: Vector,
    forces: Vector,
) -> None:
    """Fill in the pads' wrenches and what they are apart (k, 3), and add to all bodies' forces.

    `places` are MuJoCo's xpos, xmat and xipos, `bodies` the payload and the last links (k + 1,),
    `twists` theirs (k + 1, 6), angular part first; `tips` are places and attitudes of the pads in
    the last links, `pads` those on the payload, and whether they are closed; `gains` (4,) are
    stiffness [N/m, N·m/rad] and damping [N·s/m, N·m·s/rad].
    """
    xpos, xmat, xipos = places
    p_tip, R_tip = tips
    p, R_pad, closed = pads
    body = bodies[0]
    R, com = xmat[body], xipos[body]
    for i in range(len(bodies) - 1):
        tip = bodies[i + 1]
        v, own, T = twists[i + 1], twists[0], xmat[tip]
        at, arm, lever = np.empty(3), np.empty(3), np.empty(3)
        turned, force, moment = np.empty((3, 3)), np.empty(3), np.empty(3)
        for j in range(3):
            at[j] = xpos[body, j]
            way = xpos[tip, j] - xpos[body, j]
            for c in range(3):
                at[j] += R[3 * j + c] * p[i, c]
                way += T[3 * j + c] * p_tip[i, c]
            force[j] = way  # where the pad is, seen from the payload's origin, in World
            arm[j], lever[j] = at[j] - com[j], at[j] - xipos[tip, j]
        for j in range(3):
            apart[i, j] = -p[i, j]
            for c in range(3):
                apart[i, j] += R[3 * c + j] * force[c]
        for j in range(3):  # the pad's attitude on the payload, less the one that fits
            for c in range(3):
                turned[j, c] = 0.0
                for a in range(3):
                    for b in range(3):
                        fits = R_tip[i, b, 0] * R_pad[i, c, 0] + R_tip[i, b, 1] * R_pad[i, c, 1]
                        fits += R_tip[i, b, 2] * R_pad[i, c, 2]
                        turned[j, c] += R[3 * a + j] * T[3 * a + b] * fits
        half = np.empty(3)
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            half[j] = 0.5 * (turned[b, a] - turned[a, b])
        sine = math.sqrt(half[0] ** 2 + half[1] ** 2 + half[2] ** 2)
        cosine = 0.5 * (turned[0, 0] + turned[1, 1] + turned[2, 2] - 1.0)
        scale = math.atan2(sine, cosine) / sine if sine > 1e-12 else 1.0
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            # What the pad moves, relative to the payload, in World.
            force[j] = v[3 + j] + v[a] * lever[b] - v[b] * lever[a]
            force[j] -= own[3 + j] + own[a] * arm[b] - own[b] * arm[a]
            moment[j] = v[j] - own[j]
        for j in range(3):
            linear, angular = gains[0] * apart[i, j], gains[1] * scale * half[j]
            for c in range(3):
                linear += gains[2] * R[3 * c + j] * force[c]
                angular += gains[3] * R[3 * c + j] * moment[c]
            wrenches[i, j], wrenches[i, 3 + j] = closed[i] * linear, closed[i] * angular
        for j in range(3):
            force[j] = moment[j] = 0.0
            for c in range(3):
                force[j] += R[3 * j + c] * wrenches[i, c]
                moment[j] += R[3 * j + c] * wrenches[i, 3 + c]
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            forces[body, j] += force[j]
            forces[body, 3 + j] += moment[j] + arm[a] * force[b] - arm[b] * force[a]
            forces[tip, j] -= force[j]
            forces[tip, 3 + j] -= moment[j] + lever[a] * force[b] - lever[b] * force[a]


# --- A payload that several arms hold: a box on sprung pads, with pegs, and the truth about it ----
#
# Each pad is a spring of six freedoms between a flange and the payload. Its wrench is computed
# at every physics step and put on both bodies, where the force/torque sensors feel it: a spring
# between two arms of one tree of bodies would be a joint, of which a loop has one too many.

BEAM = "beam"
"""Body of the payload."""
_A_BODY: Final = mujoco.mjtObj.mjOBJ_BODY


class Pad(NamedTuple):
    """One grasp of the payload."""

    tip: int
    """Body of the arm's last link."""
    p_tip: Vector
    """The pad's place and attitude in the last link: (3,) [m] and (3, 3)."""
    R_tip: Vector


def held_by(cell: Cell) -> list[int]:
    """Return which mechanisms hold the payload, by their places in the cell."""
    names = [part.config.mechanism.name for part in cell.parts]
    return [names.index(name) for name in cell.joint_tasks[0].by]


def add_beam(spec: mujoco.MjSpec, beam: RigBeamSection) -> None:
    """Add the payload with its pegs, free to move; `Beam` brings it into the grasps."""
    body = spec.worldbody.add_body(name=BEAM)
    body.add_freejoint(name=BEAM)
    x, y, z = beam.half_size
    body.mass, body.explicitinertial, body.ipos = beam.mass, True, beam.com
    body.inertia = tuple(beam.mass / 3.0 * (a * a + b * b) for a, b in ((y, z), (x, z), (x, y)))
    box = body.add_geom(
        name=f"{BEAM}_box", type=mujoco.mjtGeom.mjGEOM_BOX, size=beam.half_size, density=0
    )
    # It meets what stands around; the arms that hold it reach into it.
    box.contype, box.conaffinity = 0, FIXED
    box.solref[:], box.solimp[:] = SOLREF, SOLIMP
    for i, place in enumerate(beam.pegs):
        along = np.zeros(4)
        mujoco.mju_mulQuat(along, np.array(quaternion(place)), _X_FOR_Z)
        peg = body.add_body(name=f"{BEAM}_peg_{i}", pos=place.xyz, quat=along)
        make_peg(peg, beam.peg, f"{BEAM}_peg_{i}")


_X_FOR_Z = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
"""Turns z to where x was: a peg's axis is z."""


class Beam:
    """The payload of one world: its pads' springs, and what is true of it.

    Vectors are in the payload's axes, which are those of the MRF.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, cell: Cell) -> None:
        """Find it in the model; `grasp` brings it into the grasps."""
        rig = cell.config.rig
        if rig is None or rig.beam is None or not cell.joint_tasks:
            raise ValueError(f"cell {cell.config.name} has no [rig.beam] with a joint task")
        self._model, self._data, self._section = model, data, rig.beam
        self.body = int(model.body(BEAM).id)
        self._at = int(model.joint(BEAM).qposadr[0])
        self._first = _placed(cell.joint_tasks[0].T_wrist_mrf[0])
        self.held_by = held_by(cell)
        """Which mechanisms hold it, by their places in the cell."""
        parts = [cell.parts[i] for i in self.held_by]
        self._pads = [_pad(model, part) for part in parts]
        k = len(self._pads)
        self._p, self._R = np.zeros((k, 3)), np.zeros((k, 3, 3))
        self._closed = np.ones(k)
        """1 for a pad that holds the payload, 0 for one that it slipped out of."""
        # As `pull_pads` takes them: the payload and the last links, and MuJoCo's own arrays.
        self._p_tip = np.array([pad.p_tip for pad in self._pads])
        self._R_tip = np.array([pad.R_tip for pad in self._pads])
        self._bodies = np.array([self.body, *(pad.tip for pad in self._pads)])
        self._twists = np.zeros((k + 1, 6))
        self._places = (data.xpos, data.xmat, data.xipos)
        self._forces: Vector = data.xfrc_applied
        self._gains = np.array([*rig.beam.grasp_stiffness, *rig.beam.grasp_damping])
        self.wrenches = np.zeros((k, 6))
        """Wrench that each arm exerts on the payload, at its pad (k, 6) [N, N·m]."""
        self._apart = np.zeros((k, 3))
        self._lifted = np.zeros(3)
        self._pegs = [int(model.body(f"{BEAM}_peg_{i}").id) for i in range(len(rig.beam.pegs))]
        self._holes = {hole.name: hole for hole in rig.holes}

    def grasp(self) -> None:
        """Put the payload where the first arm has it, and close all pads on it where they are."""
        mujoco.mj_kinematics(self._model, self._data)
        data, tip = self._data, self._pads[0].tip
        p, R = self._first
        R_tip = data.xmat[tip].reshape(3, 3)
        data.qpos[self._at : self._at + 3] = data.xpos[tip] + R_tip @ p
        mujoco.mju_mat2Quat(data.qpos[self._at + 3 : self._at + 7], (R_tip @ R).ravel())
        mujoco.mj_kinematics(self._model, data)
        for i, misfit in enumerate(self._section.misfit or [(0.0,) * 3] * len(self._pads)):
            at, turned = self._seen(i)
            self._p[i], self._R[i] = at + np.array(misfit), turned

    def shift(self, pad: int, by: Vector) -> None:
        """Make a pad fit elsewhere on the payload, by (3,) [m] from where it does."""
        self._p[pad] += by

    def turn(self, pad: int, by: Vector) -> None:
        """Make a pad fit at another attitude on the payload, by a rotation vector (3,) [rad]."""
        quat, R = np.zeros(4), np.zeros(9)
        angle = float(np.linalg.norm(by))
        mujoco.mju_axisAngle2Quat(quat, by / angle, angle)
        mujoco.mju_quat2Mat(R, quat)
        self._R[pad] = R.reshape(3, 3) @ self._R[pad]

    def let_go(self, pad: int) -> None:
        """Open a pad: the payload slips out of it."""
        self._closed[pad] = 0.0

    def take(self, pad: int) -> None:
        """Close a pad again on the payload, where it is on it now."""
        if not self._closed[pad]:
            mujoco.mj_kinematics(self._model, self._data)
            self._p[pad], self._R[pad] = self._seen(pad)
            self._closed[pad] = 1.0

    def lift(self, force: Vector) -> None:
        """Push the payload at its centre of mass with a World force (3,) [N], from now on."""
        self._lifted = np.asarray(force, dtype=float)

    def clear(self) -> None:
        """Take off arms and payload whatever was put on them in the step before."""
        self._forces[self._bodies] = 0.0

    def pull(self) -> None:
        """Add the pads' wrenches on arms and payload, for the positions and speeds of now."""
        for body, twist in zip(self._bodies.tolist(), self._twists, strict=True):
            mujoco.mj_objectVelocity(self._model, self._data, _A_BODY, body, twist, 0)
        self._forces[self.body, :3] += self._lifted
        pull_pads(
            self._places, self._bodies, self._twists, (self._p_tip, self._R_tip),
            (self._p, self._R, self._closed), self._gains, self.wrenches, self._apart, self._forces,
        )  # fmt: skip

    def internal_force(self) -> float:
        """Return the greatest force at a grasp that moves nothing [N].

        That is what the wrenches at the grasps are beyond the least ones that sum up to the same.
        """
        k = len(self._pads)
        G = np.zeros((6, 6 * k))
        for i, p in enumerate(self._p):
            G[:, 6 * i : 6 * i + 6] = np.eye(6)
            G[3:, 6 * i : 6 * i + 3] = [[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]]
        exerted = self.wrenches.ravel()
        left = (exerted - np.linalg.pinv(G) @ (G @ exerted)).reshape(k, 6)
        return float(np.linalg.norm(left[:, :3], axis=1).max())

    def stretch(self) -> float:
        """Return how far the pads are from fitting each other [m], the two that fit least."""
        apart = self._apart
        return float(max(np.linalg.norm(a - b) for a in apart for b in apart))

    def pose(self) -> tuple[Vector, Vector]:
        """Return the payload's origin (3,) [m] and rotation matrix (3, 3) in World."""
        mujoco.mj_kinematics(self._model, self._data)
        at = self._data.xpos[self.body].copy()
        return at, self._data.xmat[self.body].reshape(3, 3).copy()

    def peg_depths(self) -> tuple[float, ...]:
        """Return how deep each peg's end is in the nearest hole [m]; negative before its mouth."""
        mujoco.mj_kinematics(self._model, self._data)
        return tuple(self._depth(peg) for peg in self._pegs)

    def _depth(self, peg: int) -> float:
        data, found = self._data, []
        for name, hole in self._holes.items():
            body = self._model.body(name).id
            at = data.xmat[body].reshape(3, 3).T @ (data.xpos[peg] - data.xpos[body])
            aside = float(np.hypot(at[0], at[1]))
            found.append((aside, _inside(hole, aside, -float(at[2]))))
        return min(found)[1] if found else -np.inf

    def _seen(self, pad: int) -> tuple[Vector, Vector]:
        """Return where a pad is on the payload: place (3,) [m] and attitude (3, 3)."""
        data, (tip, p, R) = self._data, self._pads[pad]
        R_beam, R_tip = data.xmat[self.body].reshape(3, 3), data.xmat[tip].reshape(3, 3)
        at = data.xpos[tip] + R_tip @ p - data.xpos[self.body]
        return R_beam.T @ at, R_beam.T @ R_tip @ R


def _inside(hole: RigHoleSection, aside: float, deep: float) -> float:
    """Return how deep a peg is that is `aside` of the axis and `deep` below the mouth [m]."""
    return deep if deep < 0.0 or aside < hole.radius else 0.0


def _pad(model: mujoco.MjModel, part: Cell) -> Pad:
    mechanism = part.config.mechanism
    tip = int(model.body(part.prefix + mechanism.tip_link).id)
    return Pad(tip, *_placed(mechanism.T_wrist_mrf))


def _placed(pose: PoseSection) -> tuple[Vector, Vector]:
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, np.array(quaternion(pose)))
    return np.array(pose.xyz), R.reshape(3, 3)
