"""Loads that arms bear at rest, against what they are made for: rating, joint torques, sensor.

Judged for `check`, and for load shares that an operator asks for (Williams 1997, section 3).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...config.consistency import REQUIRED_POSTURES
from ...config.load import Cell
from ...config.schema.joint_task import JointTaskSection
from ...config.schema.mechanism import ForceTorqueSection, PayloadSection
from ...config.schema.section import PoseSection
from ...protocols.canopen.robotous import AXES
from ..control.joint_task.load_shares import load_shares
from ..control.mechanism.model import Dynamics, Mechanism
from ..control.spatial import GRAVITY, Array, Pose, rotate_twist, skew, wrench_to

# --- One arm: its torques, and what its sensor reads ----------------------------------------------


class Used(NamedTuple):
    """Part of a rating that a load takes, where it takes most."""

    share: float
    """Of the rating; beyond 1 it is not borne [1]."""
    part: str
    """Name of the joint, or of the sensor's axis; empty for the arm as a whole."""
    most: float
    """The rating [kg, N·m or N]."""
    unit: str
    where: str
    """Where it takes most: `at POSTURE`."""


NOTHING = Used(0.0, "", np.inf, "", "")
"""Of a rating that nobody tells, or a sensor that is not there."""


def dynamics_of(cell: Cell) -> Dynamics:
    """Return the dynamics of one arm, with the links of the URDF for its tool."""
    mechanism, sensor = Mechanism.from_cell(cell), cell.config.mechanism.force_torque
    rotors = np.array([drive.rotor_inertia for drive in cell.config.mechanism.drives])
    return Dynamics(mechanism, rotors, None if sensor is None else placed(sensor))


def most_torques(cell: Cell) -> Array:
    """Return what each joint's motor has (n,) [N·m]."""
    return np.array([drive.max_torque for drive in cell.config.mechanism.drives])


def placed(sensor: ForceTorqueSection) -> Pose:
    """Return where a sensor is in the Wrist."""
    return Pose.from_xyz_rpy(sensor.T_wrist_sensor.xyz, sensor.T_wrist_sensor.rpy)


def sensor_up(cell: Cell, q: Array) -> Array:
    """Return the vertical (3,) in the axes of the arm's sensor at q (n,)."""
    R_wrist_sensor = Pose.identity().R
    if cell.config.mechanism.force_torque is not None:
        R_wrist_sensor = placed(cell.config.mechanism.force_torque).R
    up: Array = (Mechanism.from_cell(cell).pose_wrist(q).R @ R_wrist_sensor)[2]
    return up


def weight_map(payload: PayloadSection) -> Array:
    """Return (6, 3): the wrench [N, N·m] that holds a payload, of the vertical in Sensor axes."""
    return weight_of_mass(payload.mass, np.array(payload.com))


def weight_of_mass(mass: float, com: Array) -> Array:
    """Return (6, 3): the wrench that holds a mass [kg] at `com` (3,), of the vertical."""
    weight = -mass * float(GRAVITY[2])
    return np.vstack([weight * np.eye(3), weight * skew(com)])


def reading(sensor: ForceTorqueSection, held: Array, at: Mapping[str, Array]) -> Used:
    """Return which part of its measuring range a sensor's reading of a load takes.

    `held` (6, 3) is the wrench that holds it, of the vertical in Sensor axes, which `at` has by the
    names of postures; without any: at whichever attitude it takes most.
    """
    reading_of = np.eye(6)
    if sensor.calibration is not None:
        reading_of = np.linalg.inv(np.array(sensor.calibration))
    bias, most = np.abs(sensor.bias), np.array(sensor.measuring_range)
    found = {f"at {name}": np.abs(reading_of @ held @ up) for name, up in at.items()}
    if not found:
        found = {"at some attitude": np.linalg.norm(reading_of @ held, axis=1)}
    share, axis, where = 0.0, 0, ""
    for name, read in found.items():
        used = (read + bias) / most
        if used.max() >= share:
            share, axis, where = float(used.max()), int(used.argmax()), name
    unit = "N" if axis < 3 else "N·m"
    return Used(share, AXES[axis], float(most[axis]), unit, where)


# --- Arms that hold one payload: what each bears of it with given shares --------------------------


NOW = "its place now"
"""Name of the posture that an arm is in."""


class ArmLoad(NamedTuple):
    """What one arm bears of a payload."""

    payload: Used
    """Of its rated payload."""
    holding: Used
    """Of a joint's torque."""
    reading: Used
    """Of its sensor's range."""
    turned: Used
    """The same at whichever attitude it takes most."""


class Carried(NamedTuple):
    """A payload as arms hold it now."""

    mass: float
    """[kg]."""
    com: Array
    """Its centre of mass (3,) in the payload's frame [m]: where the MRF was at start."""
    T_payload_mrf: Pose
    """The MRF in force; W is along its axes."""
    q: tuple[Array, ...]
    """Joints (n,) of each arm [rad]."""


class SharedLoad:
    """The payload of one joint task, shared out among its arms."""

    def __init__(self, section: JointTaskSection, parts: Sequence[Cell]) -> None:
        """Build it; `parts` are those of the arms that hold the payload, in their order."""
        self._section, self._parts = section, tuple(parts)
        self._models = [Mechanism.from_cell(part) for part in parts]
        self._dynamics = [dynamics_of(part) for part in parts]
        self._most = [most_torques(part) for part in parts]
        self._tools = poses([part.config.mechanism.T_wrist_mrf for part in parts])
        self._views = poses(section.T_wrist_mrf)
        for part, dynamics in zip(parts, self._dynamics, strict=True):
            sensor = part.config.mechanism.force_torque
            if sensor is not None:
                dynamics.carry(sensor.payload.mass, np.array(sensor.payload.com))

    def refusal(self, weights: Array, now: Array, carried: Carried) -> str | None:
        """Return why arms do not bear a payload as diagonals of W (k, 6) share it out, or None.

        What is beyond its bound with those of `now` (k, 6), too, may be as far beyond.
        """
        names = self._section.by
        before, after = self.borne(now, carried), self.borne(weights, carried)
        for name, old, new in zip(names, before, after, strict=True):
            for was, found, words in (
                (old.payload, new.payload, "its share of the payload is"),
                (old.holding, new.holding, f"joint {new.holding.part} takes"),
                (old.reading, new.reading, f"axis {new.reading.part} of its sensor reads"),
            ):
                if found.share > max(1.0, was.share):
                    value, unit = found.share * found.most, found.unit
                    return (
                        f"{name}: {words} {value:.3g} {unit} {found.where}, at most "
                        f"{found.most:.4g} {unit}"
                    )
        return None

    def borne(self, weights: Array, carried: Carried | None = None) -> list[ArmLoad]:
        """Return what each arm bears with the diagonals of W, `weights` (k, 6).

        At the postures that all arms have by one name, as the shares are there, and where they are
        while a payload is `carried`; None: as the cell has it, at start.
        """
        views, weight = self._views, weight_map(self._section.payload)
        if carried is not None:
            T = carried.T_payload_mrf
            views = [view @ T for view in views]
            weight = weight_of_mass(carried.mass, T.R.T @ (carried.com - T.p))
        grasps = [view.inverse() @ tool for view, tool in zip(views, self._tools, strict=True)]
        p = np.array([grasp.p for grasp in grasps])
        # Of a unit vertical along each axis of the MRF: (3, k, 6).
        shares = np.array([load_shares(p, weights, column) for column in weight.T])
        return [
            self._of_arm(
                i,
                views[i],
                grasps[i],
                shares[:, i].T,
                {} if carried is None else {NOW: carried.q[i]},
            )
            for i in range(len(self._parts))
        ]

    def _of_arm(
        self, i: int, view: Pose, grasp: Pose, share: Array, now: Mapping[str, Array]
    ) -> ArmLoad:
        """Return what one arm bears with its `share` (6, 3) of the vertical at the MRF.

        At the postures by name, and where it is `now` (n,), by the name of that.
        """
        part, model = self._parts[i], self._models[i]
        mechanism, sensor = part.config.mechanism, part.config.mechanism.force_torque
        postures = {key: np.array(mechanism.postures[key]) for key in REQUIRED_POSTURES}
        postures.update(now)
        ups = {key: (model.pose_wrist(q).R @ view.R)[2] for key, q in postures.items()}
        in_tool = np.array([rotate_twist(grasp.R.T, column) for column in share.T]).T
        weighed = {key: up for key, up in ups.items() if key in ("start", NOW)}
        borne = self._payload(mechanism.rated_payload, share, weighed)
        holding = self._holding(i, postures, ups, in_tool)
        if sensor is None:
            return ArmLoad(borne, holding, NOTHING, NOTHING)
        T_sensor_tool = placed(sensor).inverse() @ self._tools[i]
        R_mrf_sensor = view.R.T @ placed(sensor).R
        at_sensor = np.array([wrench_to(T_sensor_tool, column) for column in in_tool.T]).T
        held = at_sensor @ R_mrf_sensor + weight_map(sensor.payload)
        at = {key: R_mrf_sensor.T @ up for key, up in ups.items()}
        return ArmLoad(borne, holding, reading(sensor, held, at), reading(sensor, held, {}))

    @staticmethod
    def _payload(rated: float | None, share: Array, ups: Mapping[str, Array]) -> Used:
        """Return the part of its rated payload that an arm bears."""
        if rated is None:
            return NOTHING
        found = {key: float(up @ share[:3] @ up) / -float(GRAVITY[2]) for key, up in ups.items()}
        worst = max(found, key=lambda key: found[key])
        return Used(found[worst] / rated, "", rated, "kg", f"at {worst}")

    def _holding(
        self, i: int, postures: Mapping[str, Array], ups: Mapping[str, Array], share: Array
    ) -> Used:
        """Return the torque that holds an arm with its `share` (6, 3), at and in its own MRF."""
        model, most, dynamics = self._models[i], self._most[i], self._dynamics[i]
        worst, j, at = 0.0, 0, ""
        for key, q in postures.items():
            k = model.kinematics(q, self._tools[i])
            wrench = rotate_twist(k.T_world_mrf.R, share @ ups[key])
            used = np.abs(dynamics.bias(q, np.zeros(model.n)) + k.J.T @ wrench) / most
            if used.max() >= worst:
                worst, j, at = float(used.max()), int(used.argmax()), key
        return Used(worst, model.joints[j], float(most[j]), "N·m", f"at {at}")


def poses(sections: Sequence[PoseSection]) -> list[Pose]:
    """Return the poses that sections tell."""
    return [Pose.from_xyz_rpy(T.xyz, T.rpy) for T in sections]
