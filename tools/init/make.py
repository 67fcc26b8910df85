"""From a URDF to a cell: what can be read is read, what can be found is found."""

import tempfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ...config.drives.rig_drives import greatest_inertias
from ...config.errors import ConfigError
from ...config.load import Cell, load_cell
from ..checks.findings import Severity
from ..checks.loops.stability import stability
from .draft import Draft, text_of
from .drives import HOLDS, cell_name, drive_of, range_of, set_strength
from .robot import UrdfArm, beyond, carried_mass
from .script import ScriptFigures
from .script import text_of as script_of
from .shape.shapes import Array
from .study import GRANTED, GradedPosture, Study
from .toml_text import path_from
from .tool import BALL, ToolSide

TO_WALL: Final = 0.06
"""From the ball to the wall at `ready` [m]."""
INTO_WALL: Final = 0.03
PRESS_S: Final = 4.0
"""A push lasts so long, where the arm goes straight [s]."""
GRAVITY: Final = 9.81
"""[m/s²]."""
_TRIES: Final = 40
"""So many free postures are tried for the way to a wall [1]."""


@dataclass(frozen=True)
class Made:
    """The two files of a cell, and how it was found."""

    cell: str
    script: str
    draft: Draft
    plan: ScriptFigures


def make(arm: UrdfArm, out: Path) -> Made:
    """Return the texts of a cell and its script, which will stand beside each other in `out`.

    Raises `ConfigError` for an arm that no cell can be made of.
    """
    stem = out.stem
    draft = Draft(
        arm=arm,
        name=cell_name(stem),
        urdf=str(arm.urdf.resolve()),
        script="pose_move",
        drives=[drive_of(joint) for joint in arm.chain],
        postures={},
        mrf=np.zeros(3),
        port=43300 + zlib.crc32(stem.encode()) % 2000,
    )
    middle = [
        0.5 * sum(range_of(joint, d)) for joint, d in zip(arm.chain, draft.drives, strict=True)
    ]
    draft.postures = {"start": middle, "ready": middle}
    with tempfile.TemporaryDirectory() as folder:
        bench = _Bench(Path(folder))
        plan = _planned(draft, bench)
        _gains(draft, bench)
    plan = replace_force(plan, draft)
    draft.urdf = path_from(out.parent, arm.urdf)
    draft.script = f"./{stem}_script.toml"
    return Made(text_of(draft), script_of(plan, draft.name), draft, plan)


class _Bench:
    """Loads drafts as the daemon would."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "draft.toml"

    def load(self, draft: Draft) -> Cell:
        self._path.write_text(text_of(draft), encoding="utf-8")
        return load_cell(self._path)

    def study(self, draft: Draft) -> Study:
        return Study(self.load(draft), draft.length)


def _planned(draft: Draft, bench: _Bench) -> ScriptFigures:
    """Put the tool where it looks outward, and find postures; where there are none, elsewhere.

    An arm of fewer than six axes need not go straight at the wall where it can nowhere.
    """
    draft.payload, draft.com = beyond(draft.arm)
    draft.rated = 1.01 * draft.payload + 0.01
    side = ToolSide(draft, bench.study(draft))
    wrong: ConfigError | None = None
    tries = [(straight, outward) for straight in (True, False) for outward in side.directions()]
    for straight, outward in tries:
        side.put(outward)
        draft.contacts = []
        draft.contacts = bench.study(draft).overlapping()
        _strength(draft, bench)
        try:
            return _postures(draft, bench, straight=straight)
        except ConfigError as error:
            wrong = wrong or error
    if wrong is None:
        raise ConfigError(f"{draft.arm.urdf}: link {draft.arm.tip} has no axes")
    raise wrong


def _strength(draft: Draft, bench: _Bench) -> None:
    """Set torques, accelerations and sizes by what the arm weighs and how far it reaches."""
    cell = bench.load(draft)
    study = Study(cell, draft.length)
    postures = study.drawn(300)
    gravity = np.abs([study.mechanism.gravity(q)[0] for q in postures])  # (p, n)
    moved = greatest_inertias(cell.robot, draft.arm.tip, [], 0.0)
    places = np.array([study.tool_pose(q).p for q in postures])
    draft.reach = float(np.linalg.norm(places - study.mechanism.T_world_base.p, axis=1).max())
    draft.length = float(np.clip(0.3 * draft.reach, 0.03, 0.3))
    mass = max(carried_mass(draft.arm), 1e-3)
    for k, joint in enumerate(draft.arm.chain):
        lever = 1.0 if draft.drives[k].prismatic else draft.reach
        stretched = mass * GRAVITY * lever
        set_strength(draft.drives[k], joint, gravity[:, k], float(moved[k]), stretched)


def _postures(draft: Draft, bench: _Bench, *, straight: bool) -> ScriptFigures:
    """Find `start` and `ready`, the wall in front of it, and the script's ways."""
    study = bench.study(draft)
    forward = draft.mrf / np.linalg.norm(draft.mrf)
    torques = np.array([drive.torque for drive in draft.drives])
    best: GradedPosture | None = None
    for tried, found in enumerate(study.good(forward, torques)):
        if best is None:
            best = found
        if tried >= _TRIES:
            break
        plan = _plan(draft, study, found, forward, straight=straight)
        if plan is not None:
            return plan
    if best is None:
        raise ConfigError(
            f"{draft.arm.urdf}: no posture is free: links that are never apart may need "
            "avoidance.allowed_contacts"
        )
    raise ConfigError(
        f"{draft.arm.urdf}: of {_TRIES} free postures none has room to move the tool by "
        f"{TO_WALL:g} m: is {draft.arm.tip} the arm's last link? Say --tip LINK"
    )


def _plan(
    draft: Draft, study: Study, found: GradedPosture, forward: Array, *, straight: bool
) -> ScriptFigures | None:
    """Return the script from a posture, or None where a way is not free; set what it needs."""
    least = 0.5 * found.sigma
    torques = np.array([drive.torque for drive in draft.drives])
    q, T = found.q.round(4), study.tool_pose(found.q.round(4))
    d = T.R @ forward
    scale = float(np.clip(draft.reach, 0.3, 1.0))
    toward = np.concatenate([d, np.zeros(3)])
    full = study.mechanism.rank == 6
    if (full or straight) and study.walk(q, toward, TO_WALL + INTO_WALL, 0.6 * least) is None:
        return None
    if not _wall(draft, study, q, T.p, d):
        return None
    aside = [v for v in np.eye(3) if abs(v @ d) < 0.8]
    target = start = None
    stick = np.zeros(6)
    for side in (*aside, *(-v for v in aside)):
        turn = 0.8 * np.cross(side, d)
        twist = np.concatenate([side - 0.3 * d, turn])
        reached = study.walk(q, twist, 0.08 * scale, least) if full else None
        if not full:
            reached = _nudged(study, q, 0.12)
        back = np.concatenate([0.5 * side - d, np.zeros(3)])
        begun = study.walk(q, back, 0.08 * scale, 0.6 * least) if full else None
        if begun is None:
            begun = _nudged(study, q, -0.15)
        if reached is None or begun is None or not study.free(begun, q):
            continue
        if any((study.weight(p) > HOLDS * torques).any() for p in (reached, begun)):
            continue
        target, start = reached, begun.round(4)
        stick = np.concatenate([0.02 * scale * side, np.zeros(3)])
        break
    if target is None or start is None:
        return None
    draft.postures = {"start": start.tolist(), "ready": q.tolist()}
    held = min(_carried(study, p, torques) for p in (start, q, target))
    draft.rated = max(draft.rated, min(draft.payload + held, carried_mass(draft.arm)))
    draft.singular_region = float(np.clip(0.4 * found.sigma, 1e-3, 0.05))
    speeds = np.array([drive.velocity for drive in draft.drives])
    moved_s = float((np.abs(start - q) / speeds).max()) * 1.5 + 2.0
    target_s = float((np.abs(target - q) / speeds).max()) * 2.0 + 4.0
    J = study.mechanism.kinematics(q, study.tool).J[:3]
    spare = torques - study.weight(q)
    draft.push = float(min(10.0, (0.3 * spare / np.maximum(np.abs(J.T @ d), 1e-6)).min()))
    pose = study.tool_pose(target).to_xyz_rpy()
    granted = max(GRANTED, min(1.0, study.granted(q, toward)))
    press_s = PRESS_S if granted > 0.99 else PRESS_S / granted
    return ScriptFigures(
        moved_s, stick, (np.array(pose[:3]), np.array(pose[3:])), target_s, d,
        (0.03, TO_WALL / 0.03 / granted + 1.0), 0.0, draft.push, press_s,
    )  # fmt: skip


def _carried(study: Study, q: Array, torques: Array) -> float:
    """Return the mass that half the spare torques (n,) at a posture hold at the tool [kg]."""
    arms = np.abs(study.mechanism.kinematics(q, study.tool).J[2])  # torque of a vertical force
    spare = np.maximum(HOLDS * torques - study.weight(q), 0.0)
    return float((0.5 * spare / np.maximum(arms * GRAVITY, 1e-6)).min())


def _nudged(study: Study, q: Array, by: float) -> Array | None:
    """Return a posture beside another one, all joints moved a little, or None."""
    draw = np.random.default_rng(2)
    for _ in range(40):
        other = q + by * draw.uniform(0.3, 1.0, len(q)) * draw.choice([-1.0, 1.0], len(q))
        if not study.outside(other) and study.free(q, other):
            return np.asarray(other)
    return None


def _wall(draft: Draft, study: Study, q: Array, p: Array, d: Array) -> bool:
    """Put the wall in front of the tool; return whether all of the arm is on this side of it."""
    face = p + d * (BALL + TO_WALL)
    ends = study.ends(q)
    ahead = (ends - face) @ d + study.capsules.radius[:, None]
    if float(ahead.max()) > -0.5 * TO_WALL:
        return False
    half = float(np.clip(0.25 * draft.reach, 0.05, 0.25))
    draft.wall = (face.round(4), -d, round(half, 3))
    return True


def _gains(draft: Draft, bench: _Bench) -> None:
    """Lower the force gains until the judge of stability has no complaint."""
    for _ in range(30):
        found = [f for f in stability(bench.load(draft)) if f.check.startswith("force")]
        bad = [f.check for f in found if f.status is not Severity.OK]
        if not bad:
            return
        linear, angular = draft.gain
        # A touch aside of the MRF gives way by K_R times its lever: "force tool".
        turning = [c.endswith(("rx", "ry", "rz", "tool")) for c in bad]
        if not all(turning):
            linear *= 0.8
        if any(turning):
            angular *= 0.8
        draft.gain = (float(f"{linear:.3g}"), float(f"{angular:.3g}"))


def replace_force(plan: ScriptFigures, draft: Draft) -> ScriptFigures:
    """Return the plan with the stick that pushes by its force, at the gain that was found."""
    return plan._replace(press=draft.push * draft.gain[0], force=draft.push)
