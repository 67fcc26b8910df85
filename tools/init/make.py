"""A cell for an arm from its URDF: what is found, tried and written."""

import tempfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from ...config.drives import greatest_inertias
from ...config.errors import ConfigError
from ...config.load import Cell, load_cell
from ...config.urdf.shapes import Array, Tube
from ..checks.findings import Severity
from ..checks.loops import stability
from .draft import (
    HOLDS,
    Draft,
    Wheels,
    cell_name,
    drive_of,
    path_from,
    range_of,
    set_strength,
    text_of,
)
from .robot import UrdfArm, beyond, carried_mass
from .study import BALL, GradedPosture, Study, ToolSide, by_design

# --- The default script of a cell that `init` makes: it moves, stops, and touches a wall ----------
WITHIN = 0.2  # the push on the wall is expected within this part of what is asked for [1]
AWAY = 0.3  # a base drives so far away from the wall [m]
TURN = 0.4  # and turns by so much there [rad]
ODOMETRY = 0.01  # it is expected to know where it is within [m]


class ScriptFigures(NamedTuple):
    """Figures of the script's steps; in World, from which Base begins no more than higher."""

    ready_s: float  # from `start` to `ready` [s]
    aside: Array  # twist (6,) of the stick [m/s]
    target: tuple[Array, Array]  # Pose of the MRF in Base: place [m], roll, pitch, yaw [rad]
    target_s: float
    forward: Array  # direction of the wall (3,)
    approach: tuple[float, float]  # speed of the stick towards it [m/s], and how long [s]
    press: float  # speed of the stick that pushes [m/s]
    force: float  # force that follows from it [N]; 0: no push, the arm cannot go straight
    press_s: float  # time of the push [s]


def script_text(plans: Mapping[str, ScriptFigures], name: str, wheels: Wheels | None = None) -> str:
    """Return the script's file: of an only arm, which has no name here, or of several.

    Each moves while the others stand at `ready`; a base drives away from the wall, and comes back;
    the first arm ends on the wall, where it can go straight.
    """
    at = 0.2
    steps = [_step(at, "cmd/posture", mechanism=arm, posture="ready") for arm in plans]
    at += max(plan.ready_s for plan in plans.values())
    first, *others = plans
    for arm in (*others, first):
        more, at = _moves(plans[arm], arm, at, wheels, stopped=arm == first)
        steps += more
    plan = plans[first]
    words, expected = f"{name}: a stick, a stop, and a pose", ""
    if wheels is not None:
        more, at, gone = _drive(plan, wheels, at)
        steps += more
        expected = f"base_travel_m = {{ least = {gone:.3g} }}\n"
        expected += f"odometry_error_m = {{ most = {ODOMETRY} }}\n"
    if plan.force:
        speed, lasts = plan.approach
        toward = np.concatenate([plan.forward, np.zeros(3)])
        steps += [
            "# into the wall: speed / force gain is the force that it settles at",
            _stick(first, at, speed * toward),
            _stick(first, at + lasts, plan.press * toward),
        ]
        at += lasts + plan.press_s
        words = f"{name}: a stick, a stop, a pose, and a push of {plan.force:.3g} N on the wall"
        least, most = plan.force * (1.0 - WITHIN), plan.force * (1.0 + WITHIN)
        expected += f"contact_force_n = {{ least = {least:.3g}, most = {most:.3g} }}\n"
    head = [
        f'description = "{words}"',
        f"duration_s = {at:.1f}",
        '\n[expect]\nmode = "enabled"',
        expected,
    ]
    return "\n".join([*head, *steps])


def _moves(
    plan: ScriptFigures, arm: str, at: float, wheels: Wheels | None, *, stopped: bool
) -> tuple[list[str], float]:
    """Return an arm's steps by stick and to a pose, and when they have ended."""
    steps = [f"# aside by the stick{'; the verified stop while it moves; on' * stopped}"]
    steps += [_stick(arm, at, plan.aside, 1.0)]
    if stopped:
        steps += [_step(at + 1.0, "operator/mode", action="hold")]
        steps += [_step(at + 2.0, "operator/mode", action="resume")]
    at += 2.5
    xyz, rpy = plan.target
    frame = "world" if wheels is None else "base"
    steps += ["# to a pose, and back"]
    steps += [_step(at, "cmd/position", task=arm, xyz=xyz, rpy=rpy, relative_to=frame)]
    at += plan.target_s
    steps += [_step(at, "cmd/cancel", task=arm)]
    steps += [_step(at, "cmd/posture", mechanism=arm, posture="ready")]
    return steps, at + max(plan.ready_s, plan.target_s)


def _drive(plan: ScriptFigures, wheels: Wheels, at: float) -> tuple[list[str], float, float]:
    """Return the steps of a base, when they have ended [s], and how far it goes at least [m].

    Straight away from the wall, a turn away from it, and both back again.
    """
    x, y = plan.target[0][:2].tolist()
    away = -1.0 if plan.forward[0] > 0.0 else 1.0
    aside = -1.0 if x * plan.forward[1] - y * plan.forward[0] > 0.0 else 1.0
    v, w = away * min(0.15, wheels.speed), aside * min(0.3, wheels.angular_speed)
    go_s, turn_s = AWAY / abs(v), TURN / abs(w)
    steps = ["# the base: straight away from the wall, a turn, and back again"]
    for ahead, turn, for_s in (
        (v, 0.0, go_s),
        (0.0, w, turn_s),
        (0.0, -w, turn_s),
        (-v, 0.0, go_s),
    ):
        steps += [_step(at, "cmd/drive", rates=[ahead, turn])]
        steps += [_step(at + for_s, "cmd/drive", rates=[0.0, 0.0])]
        at += for_s + 1.0
    return steps, at, 1.9 * AWAY


def _stick(arm: str, at: float, twist: Array, for_s: float | None = None) -> str:
    return _step(at, "cmd/joystick", for_s, task=arm, twist=twist, expressed_in="world")


def _step(
    at: float, topic: str, for_s: float | None = None, **fields: str | Array | list[float]
) -> str:
    """Return a step as its file says it; an empty field, as an only arm's name, is left out."""
    told = []
    for key, value in fields.items():
        if isinstance(value, str):
            told += [f'{key} = "{value}"'] if value else []
        else:
            told += [f"{key} = [{', '.join(f'{float(v) + 0.0:.5f}' for v in value)}]"]
    lasts = "" if for_s is None else f"for_s = {for_s}\n"
    message = f"{{ {', '.join(told)} }}" if told else "{}"
    return f'[[step]]\nat_s = {at:.2f}\n{lasts}"{topic}" = {message}\n'


# --- From a URDF to a cell: what can be read is read, what can be found is found ------------------
TO_WALL: Final = 0.06  # from the ball to the wall at `ready` [m]
INTO_WALL: Final = 0.03
SHORT_OF_WALL: Final = 0.004
"""Before the wall the stick slows down to the speed that presses, so far [m]."""
PUSH: Final = 10.0  # force of the script on the wall, where the drives are strong enough [N]
HARDEST: Final = 100.0
HUNTS: Final = 8e-5
"""Drives with friction place a tool no better: what that presses is lost in a push [m]."""
QUIET: Final = 0.3  # a force loop of this gain, K_F k T, does not ring [1]
STRAIGHT: Final = 0.99
"""An arm that goes less of a straight way slides along a wall: friction decides what it presses."""
PRESS_S: Final = 4.0  # a push lasts so long [s]
GRAVITY: Final = 9.81  # [m/s²]
WALL_HALF: Final = 0.07
"""Radius of rods that stand for the wall where another arm is planned beside it [m]."""
_TRIES: Final = 40  # so many free postures are tried for the way to a wall [1]


@dataclass(frozen=True)
class Made:
    """The two files of a cell, and how it was found."""

    cell: str
    script: str
    drafts: tuple[Draft, ...]  # one for each arm
    plans: tuple[ScriptFigures, ...]

    @property
    def draft(self) -> Draft:
        """The first arm's."""
        return self.drafts[0]


def make(arms: UrdfArm | Sequence[UrdfArm], out: Path, base: Wheels | str | None = None) -> Made:
    """Return the texts of a cell and its script, which will stand beside each other in `out`.

    Of one arm, or of all that one URDF holds; `base` is what carries them, by `base_of`. Raises
    `ConfigError` for an arm that no cell can be made of.
    """
    stem = out.stem
    drafts: list[Draft] = []
    plans: list[ScriptFigures] = []
    contacts: list[tuple[str, str]] = []
    with tempfile.TemporaryDirectory() as folder:
        bench = _Bench(Path(folder))
        for arm in [arms] if isinstance(arms, UrdfArm) else arms:
            draft = Draft(
                arm=arm,
                name=cell_name(stem),
                urdf=str(arm.urdf.resolve()),
                script="pose_move",
                drives=[drive_of(joint) for joint in arm.chain],
                postures={},
                mrf=np.zeros(3),
                port=43300 + zlib.crc32(stem.encode()) % 2000,
                fits=arm.fits,
                wheels=base if isinstance(base, Wheels) else None,
                base_held=base if isinstance(base, str) and not drafts else "",
            )
            middle = [
                0.5 * sum(range_of(joint, d))
                for joint, d in zip(arm.chain, draft.drives, strict=True)
            ]
            draft.postures = {"start": middle, "ready": middle}
            plan = _planned(draft, bench)
            _gains(draft, bench)
            drafts.append(draft)
            press = draft.push * draft.gain[0]
            press_s = plan.press_s + SHORT_OF_WALL / press if press else 0.0
            plans.append(plan._replace(press=press, force=draft.push, press_s=press_s))
            bench.beside += _around(draft, bench.study(draft))
        if len(drafts) > 1:
            contacts = by_design(bench.load(*drafts))
    for draft in drafts:
        draft.urdf = path_from(out.parent, draft.arm.urdf)
        draft.script = f"./{stem}_script.toml"
    names = [draft.arm.name if len(drafts) > 1 else "" for draft in drafts]
    script = script_text(dict(zip(names, plans, strict=True)), drafts[0].name, drafts[0].wheels)
    return Made(text_of(drafts, contacts), script, tuple(drafts), tuple(plans))


class _Bench:
    """Loads drafts as the daemon would."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "draft.toml"
        self.beside: list[Tube] = []  # what arms that have been drafted pass through, and the wall

    def load(self, *drafts: Draft) -> Cell:
        self._path.write_text(text_of(drafts, rolls=False), encoding="utf-8")
        return load_cell(self._path)

    def study(self, draft: Draft) -> Study:
        return Study(self.load(draft), draft.length, self.beside)


def _around(draft: Draft, study: Study) -> list[Tube]:
    """Return the capsules of an arm at all postures that its script leads through, and its wall."""
    moved = study.capsules.moves.any(axis=1)
    found = [
        Tube(ends[0], ends[1], float(radius))
        for q in draft.passes
        for ends, radius in zip(
            study.ends(q)[moved], study.capsules.radius[moved].tolist(), strict=True
        )
    ]
    if draft.wall is not None:
        centre, normal, half = draft.wall
        across = np.linalg.svd(normal[None])[2][1:]
        found += [
            Tube(centre + x * half * across[0] - half * across[1],
                  centre + x * half * across[0] + half * across[1], WALL_HALF)
            for x in (-1.0, -0.5, 0.0, 0.5, 1.0)
        ]  # fmt: skip
    return found


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
    if not study.beside and not _wall(draft, study, q, T.p, d):
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
    at_wall = study.walk(q, toward, TO_WALL, 0.0)
    ends = [start, target, *([] if at_wall is None else [at_wall])]
    draft.passes = [q, *(q + s * (end - q) for end in ends for s in (0.5, 1.0))]
    held = min(_carried(study, p, torques) for p in (start, q, target))
    draft.rated = max(draft.rated, min(draft.payload + held, carried_mass(draft.arm)))
    draft.singular_region = float(np.clip(0.4 * found.sigma, 1e-3, 0.05))
    speeds = np.array([drive.velocity for drive in draft.drives])
    moved_s = float((np.abs(start - q) / speeds).max()) * 1.5 + 2.0
    target_s = float((np.abs(target - q) / speeds).max()) * 2.0 + 4.0
    J = study.mechanism.kinematics(q, study.tool).J[:3]
    spare = torques - study.weight(q)
    least = max(PUSH, HUNTS / _yields(study, q, forward))
    most = float((0.3 * spare / np.maximum(np.abs(J.T @ d), 1e-6)).min())
    draft.push = float(f"{min(least, HARDEST, most):.2g}")
    pose = (study.mechanism.T_world_base.inverse() @ study.tool_pose(target)).to_xyz_rpy()
    if study.granted(q, toward) < STRAIGHT:
        draft.push = 0.0
    return ScriptFigures(
        moved_s, stick, (np.array(pose[:3]), np.array(pose[3:])), target_s, d,
        (0.03, (TO_WALL - SHORT_OF_WALL) / 0.03), 0.0, draft.push, PRESS_S,
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
            draft.sideways = float(f"{_sideways(draft, bench):.3g}")
            return
        linear, angular = draft.gain
        # A touch aside of the MRF gives way by K_R times its lever: "force tool".
        turning = [c.endswith(("rx", "ry", "rz", "tool")) for c in bad]
        if not all(turning):
            linear *= 0.8
        if any(turning):
            angular *= 0.8
        draft.gain = (float(f"{linear:.3g}"), float(f"{angular:.3g}"))


def _sideways(draft: Draft, bench: _Bench) -> float:
    """Return the force gain [m/s/N] that is quiet while friction holds the tool at `ready`."""
    study = bench.study(draft)
    forward = draft.mrf / np.linalg.norm(draft.mrf)
    yields = _yields(study, np.array(draft.postures["ready"]), forward)
    return min(draft.gain[0], QUIET * yields / study.cell.config.timing.period_s)


def _yields(study: Study, q: Array, forward: Array) -> float:
    """Return how far a tool that is held across gives way at least, in the drives [m/N]."""
    at, rig = study.mechanism.kinematics(q, study.tool), study.cell.config.rig
    if rig is None:
        raise ValueError("a draft has a [rig]")
    across = np.linalg.svd((at.T_world_mrf.R @ forward)[None])[2][1:]
    J = across @ at.J[:3]
    yields = np.linalg.eigvalsh((J / np.array(rig.drive.stiffness)) @ J.T)
    return max(float(yields[0]), 1e-9)
