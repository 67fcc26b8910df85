"""Common to the rig's geoms: who touches whom, how hard; and capsules of links with meshes."""

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

from ....config.load import Cell
from ....config.schema.section import PoseSection

# --- Common to the rig's geoms: who touches whom and how hard, and how poses are written ----------

ARM, FIXED = 1, 2
"""Contact groups; fixed things never meet."""
SOLREF = (0.004, 1.0)
SLIDING_SOLREF = (0.04, 1.0)
"""Of friction where the tool slides. MuJoCo's contacts are convex: what slips is lifted by as much
as slip is damped, at 4 ms by 0.4 mm at 0.05 m/s, where contact ends. The tool would hop, closed for
a millisecond and open for four."""
SOLIMP = (0.95, 0.99, 0.001, 0.5, 2.0)


def of_arm(geom: mujoco.MjsGeom) -> mujoco.MjsGeom:
    """Make a geom touch like a part of the arm; return it."""
    geom.contype, geom.conaffinity = ARM, ARM | FIXED
    geom.solref[:], geom.solimp[:] = SOLREF, SOLIMP
    return geom


def fixed(geom: mujoco.MjsGeom) -> mujoco.MjsGeom:
    """Make a geom touch like a thing that stands around; return it."""
    geom.contype, geom.conaffinity = FIXED, ARM
    geom.solref[:], geom.solimp[:] = SOLREF, SOLIMP
    return geom


def owners(model: mujoco.MjModel, roots: Sequence[int]) -> list[int]:
    """Return which root each body of a model descends from, the nearest: its place, -1 for none."""
    place: dict[int, int] = {root: i for i, root in enumerate(roots)}
    found = [-1]
    for body, parent in enumerate(model.body_parentid.tolist()[1:], start=1):
        found.append(place.get(body, found[parent]))
    return found


def bound_contacts(model: mujoco.MjModel) -> None:
    """Give no body less freedom in contacts than all that moves with it has on one slide.

    MuJoCo makes a contact as stiff as the bodies' mean inverse inertia at the reference posture is
    small. A first link that turns about its own axis has none, so that what is moved into it by a
    micrometre would be pressed with 1e10 N, although nothing of either could give way.
    """
    roots = model.body_rootid
    moves = (model.body_weldid > 0) & (model.body_mocapid[roots] < 0)
    least = 1.0 / (3.0 * np.maximum(model.body_subtreemass[roots], mujoco.mjMINVAL))
    freedom = model.body_invweight0[:, 0]
    freedom[moves] = np.maximum(freedom, least)[moves]


def slides_on(spec: mujoco.MjSpec, tool: str, surface: mujoco.MjsGeom) -> None:
    """Let a geom of the tool slide on a surface without hopping; friction is as it was."""
    pair = spec.add_pair(geomname1=tool, geomname2=surface.name)
    pair.condim, pair.friction[:] = surface.condim, np.repeat(surface.friction, (2, 1, 2))
    pair.solref[:], pair.solreffriction[:], pair.solimp[:] = SOLREF, SLIDING_SOLREF, SOLIMP


def quaternion(pose: PoseSection) -> tuple[float, float, float, float]:
    """Return a pose's rotation (fixed-axis roll, pitch, yaw) as MuJoCo's w, x, y, z."""
    quat = np.zeros(4)
    mujoco.mju_euler2Quat(quat, np.array(pose.rpy), "XYZ")
    w, x, y, z = quat.tolist()
    return w, x, y, z


# --- Shapes of links whose URDF has meshes: the capsules that the cell has around them ------------

FEATHER: Final = 1e-6
"""Mass of a link that carries all its weight in what is fixed to it [kg]."""


def add_capsules(arm: mujoco.MjSpec, part: Cell) -> None:
    """Add the cell's capsules to links that have meshes, as their shape.

    The one around the MRF is the tool's, which has its ball.
    """
    bare = set(part.robot.mesh_links())
    mechanism = part.config.mechanism
    for given in part.config.avoidance.capsules:
        link = given.link.removeprefix(part.prefix)
        body = arm.body(link) if link in bare or given.holds else None
        if body is None:
            continue
        start, end = np.array(given.start), np.array(given.end)
        if link == mechanism.tip_link and _holds(
            start, end, given.radius, np.array(mechanism.T_wrist_mrf.xyz)
        ):
            continue
        if np.linalg.norm(end - start) < 1e-6:
            geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=start)
        else:
            geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE)
            geom.fromto[:] = [*start, *end]
        geom.size[0] = given.radius


def exclude_contacts(arm: mujoco.MjSpec, cell: Cell) -> None:
    """Let links touch that the cell lets overlap: of one arm, or of several where it has them."""
    found = {frozenset((e.bodyname1, e.bodyname2)) for e in arm.excludes}
    for pair in cell.config.avoidance.allowed_contacts:
        prefix = "" if cell.others else cell.prefix
        first, second = (name.removeprefix(prefix) for name in (pair.link, pair.other))
        names = frozenset((first, second))
        if len(names) == 2 and names not in found and arm.body(first) and arm.body(second):
            found.add(names)
            arm.add_exclude(bodyname1=first, bodyname2=second)


def give_mass(arm: mujoco.MjSpec) -> None:
    """Give a trace of mass to links that move and have none: all theirs is fixed to them."""
    for body in arm.bodies[1:]:
        if body.joints and body.mass <= 0.0:
            body.mass, body.inertia, body.explicitinertial = FEATHER, [1e-3 * FEATHER] * 3, True


def _holds(start: np.ndarray, end: np.ndarray, radius: float, point: np.ndarray) -> bool:
    along = end - start
    length2 = max(float(along @ along), 1e-18)
    part = min(1.0, max(0.0, float((point - start) @ along) / length2))
    return float(np.linalg.norm(point - start - part * along)) < radius
