"""A cell in the making, and its text."""

import math
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from string import Formatter
from typing import Any, Final

import numpy as np

from ...config.urdf.robot import CONTINUOUS_RANGE
from ...config.urdf.shapes import Array
from .capsules import Fit
from .robot import UrdfArm


# --- Values as a TOML file has them, and the paths that it names ----------------------------------
def path_from(folder: Path, file: Path) -> str:
    """Return the path of a file as seen from a folder, so that both can move together.

    Whole where they share no folder but the root.
    """
    folder, file = folder.resolve(), file.resolve()
    if file.is_relative_to(folder):
        return f"./{file.relative_to(folder)}"
    shared = os.path.commonpath([folder, file])
    return str(file) if shared == os.sep else os.path.relpath(file, folder)


def quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def plain(text: str) -> str:
    """Return a text that may stand in a comment or a string: a line, not too long."""
    return "".join(c if c.isprintable() and c not in '"\\' else "_" for c in text)[:120]


def number(value: float) -> str:
    """Return a number with four digits, and a point."""
    text = f"{float(value):.4g}"
    return text if any(c in text for c in ".en") else f"{text}.0"


def bound(value: float) -> str:
    """Return a positive number that is no more than a bound, with four digits."""
    if value <= 0.0:
        return number(value)
    digit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return number(math.floor(value / digit * (1.0 + 1e-12)) * digit)


def numbers(values: Iterable[float], digits: int = 4) -> str:
    """Return a list of numbers, so many digits after the point; small ones as powers of ten."""
    shown = []
    for value in map(float, values):
        small = 0.0 < abs(value) < 10.0 ** (1 - digits)
        text = f"{value:.3e}" if small else f"{value:.{digits}f}"
        shown.append("0.0" if float(text) == 0.0 else text)
    return "[" + ", ".join(shown) + "]"


# --- Draft of a cell while `init` makes it, and the text of its file ------------------------------
CONFIRM = "CONFIRM"  # begins every comment at something that must be confirmed


@dataclass
class DriveDraft:
    """One joint's drive."""

    joint: str
    prismatic: bool
    velocity: float
    acceleration: float
    torque: float
    lower: float | None = None
    upper: float | None = None
    notes: list[str] = field(default_factory=list)
    rolls: bool = False  # it drives a wheel

    @property
    def jerk(self) -> float:
        """Conservative jerk: the acceleration is reached in a period [rad/s³]."""
        return min(100.0 * self.acceleration, 50_000.0)


@dataclass(frozen=True)
class Wheels:
    """The two driven wheels of a base; Base, the root link, is midway between them."""

    radius: float  # [m]
    track: float  # between their points of contact [m]
    height: float  # of Base above the floor [m]
    speed: float  # the greatest of the base straight on [m/s]
    angular_speed: float  # the greatest about its axis, beside that [rad/s]
    drives: tuple[DriveDraft, DriveDraft]  # left and right

    @property
    def names(self) -> str:
        """Both joints."""
        return " and ".join(drive.joint for drive in self.drives)


@dataclass
class Draft:
    """A cell in the making."""

    arm: UrdfArm
    name: str
    urdf: str
    script: str
    drives: list[DriveDraft]
    postures: dict[str, list[float]]
    mrf: Array
    tool: tuple[Array, float] | None = None
    """Where the tool's stalk begins, in the tip link, and the radius of it and its ball [m]."""
    contacts: list[tuple[str, str]] = field(default_factory=list)
    payload: float = 0.0
    com: tuple[float, ...] = (0.0, 0.0, 0.0)
    rated: float = 1.0
    """Mass that half the drives' spare torques hold at the tip in the cell's postures, and no more
    than the arm's own [kg]."""
    gain: tuple[float, float] = (7.5e-4, 0.03)
    """Force to speed [m/s/N], moment to turning [rad/s/(N·m)]."""
    sideways: float = 7.5e-4
    """The first across the tool: friction holds it there as stiffly as the arm is [m/s/N]."""
    stiffness: tuple[float, float] = (20_000.0, 500.0)
    wall: tuple[Array, Array, float] | None = None  # centre of its face, normal, and half its side
    reach: float = 1.0  # how far from Base the tool gets [m]
    singular_region: float = 0.05
    length: float = 0.3  # weighs radians against metres [m]
    push: float = 10.0  # force of the default script on the wall; 0: it does not push [N]
    fits: list[Fit] = field(default_factory=list)  # capsules of its links, and of what stands
    passes: list[Array] = field(default_factory=list)  # postures that the script leads it through
    port: int = 43210
    wheels: Wheels | None = None  # of a base that drives
    base_held: str = ""  # why a base that moves is held


class _Writer(Formatter):
    """Writes values as a TOML file has them, in the ways that `cell.template` names."""

    _WAYS: Final[Mapping[str, Callable[[Any], str]]] = {
        "number": number,
        "bound": bound,
        "quoted": quoted,
        "plain": plain,
        "list": numbers,
        "list5": partial(numbers, digits=5),
        "list6": partial(numbers, digits=6),
    }

    def format_field(self, value: Any, format_spec: str) -> str:
        way = self._WAYS.get(format_spec)
        return format(value, format_spec) if way is None else way(value)


def _blocks() -> dict[str, list[str]]:
    text = Path(__file__).with_name("cell.template").read_text(encoding="utf-8")
    named = (block.partition("\n") for block in text.rstrip("\n").split("\n=== ")[1:])
    return {name: lines.split("\n") for name, _, lines in named}


_WRITER, _BLOCKS = _Writer(), _blocks()


def _block(block: str, **values: Any) -> list[str]:
    """Return the lines of a block of `cell.template`; of a list of lines, each."""
    found: list[str] = []
    for line in _BLOCKS[block]:
        given = values.get(line[1:-1])
        found += given if isinstance(given, list) else [_WRITER.vformat(line, (), values)]
    return found


def text_of(
    drafts: Sequence[Draft], contacts: Sequence[tuple[str, str]] = (), *, rolls: bool = True
) -> str:
    """Return the cell file: of one arm, or of several that one URDF holds.

    `contacts` are links of several that overlap wherever the arms are. Without `rolls` a base that
    drives stands where it begins, as its arm is planned.
    """
    first, several = drafts[0], len(drafts) > 1
    buses, mechanisms, tasks, wall = [], [], [], []
    for i, draft in enumerate(drafts):
        named = f'name = "{draft.arm.name}"'
        head = ["[[buses]]", named] if several else ["[bus]"]
        buses += _block("bus", head=head, group=10 + i, port=draft.port + i)
        mechanisms += _mechanism(draft, drafts, rolls=rolls)
        along = np.abs(draft.mrf) == np.abs(draft.mrf).max()
        sideways = min(draft.sideways, draft.gain[0])
        gains = [*np.where(along, draft.gain[0], sideways), *[draft.gain[1]] * 3]
        tasks += _block(
            "task",
            head=["", "[[tasks]]", named] if several else [],
            place="tasks." if several else "",
            speed=min(0.15, 0.2 * draft.reach),
            gain=", ".join(number(gain) for gain in gains),
        )
    if first.wall is not None:
        centre, normal, half = first.wall
        stiffness = first.stiffness[0]
        wall = _block("wall", centre=centre, normal=normal, half=half, stiffness=stiffness)
    named_pairs = {
        (name_in(draft, drafts, a), name_in(draft, drafts, b))
        for draft in drafts
        for a, b in draft.contacts
    } | set(contacts)
    in_order = sorted({(min(pair), max(pair)) for pair in named_pairs})
    pairs = [f"  {{ link = {quoted(a)}, other = {quoted(b)} }}," for a, b in in_order]
    lines = _block(
        "cell",
        draft=first,
        buses=buses,
        frames=_block("frames") if rolls and first.wheels is not None else [],
        mechanisms=mechanisms,
        tasks=tasks,
        speed=min(min(0.25, 0.3 * draft.reach) for draft in drafts),
        contacts=_block("contacts", each=pairs) if pairs else [],
        capsules=[line for draft in drafts for line in _capsules(draft, drafts)],
        tool=[] if several else [f"tool_radius = {number(_radius(first))}"],
        wall=wall,
    )
    return "\n".join(lines) + "\n"


def _mechanism(draft: Draft, drafts: Sequence[Draft], *, rolls: bool) -> list[str]:
    """Return the tables of one arm; those of the cell's only one are called otherwise."""
    arm, first, several = draft.arm, draft is drafts[0], len(drafts) > 1
    table = "mechanisms" if several else "mechanism"
    wheels = draft.wheels if rolls else None
    driven = [] if wheels is None else list(wheels.drives)
    held = [name for name in arm.held if name not in {drive.joint for drive in driven}]
    still = []
    if held and first:
        still += ["# Held at zero, as no part of an arm: " + plain(", ".join(held)) + "."]
    if draft.base_held:
        still += [f"# The base is held: {plain(draft.base_held)}."]
    base, gripper, inertials = [], [], []
    if wheels is not None:
        left, right = (drive.joint for drive in wheels.drives)
        base = _block("base", table=table, wheels=wheels, left=left, right=right)
    for given in arm.inertials:
        if first or given.link in arm.own:
            I = given.inertia  # noqa: E741  the field's symbol
            six = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
            inertials += _block("inertial", table=table, given=given, inertia=six)
    felt = [max(0.5 * drive.torque, 1.0) for drive in (*driven, *draft.drives)]
    each = enumerate((*driven, *draft.drives), start=1)
    drives = [line for node, drive in each for line in _drive(node, drive, table)]
    if arm.fingers:
        node = len(driven) + len(draft.drives) + 1
        gripper = _block("gripper", table=table, fingers=", ".join(arm.fingers), node=node)
    return _block(
        "mechanism",
        draft=draft,
        arm=arm,
        table=table,
        head=[f"[[{table}]]" if several else f"[{table}]"],
        bus=[f'bus = "{arm.name}"'] if several else [],
        stands=_stands(draft, drafts),
        held=still,
        base=base,
        postures=[f"{name} = {numbers(q)}" for name, q in draft.postures.items()],
        inertials=_block("inertials", each=inertials) if inertials else [],
        gripper=gripper,
        drives=drives,
        felt=", ".join(number(torque) for torque in felt),
        place=f"{table}." if several else "",
        damping=0.4 * draft.singular_region,
        floor=0.2 * draft.singular_region,
        tool=["", f"[{table}.rig]", f"tool_radius = {number(_radius(draft))}"] if several else [],
    )


def _stands(draft: Draft, drafts: Sequence[Draft]) -> list[str]:
    """Return where an arm stands, and which joints and links of its file are not its own."""
    arm, lines, without = draft.arm, [], draft.arm.without
    if draft is not drafts[0]:
        without = (arm.tree.roots[0],)
    if draft.wheels is not None and draft.wheels.height:
        lines += _block("above the floor", xyz=[0.0, 0.0, draft.wheels.height])
    if arm.first_joint is not None:
        if arm.standing:
            lines += [f"# {CONFIRM}: these stand at zero: {plain(', '.join(arm.standing))}."]
        lines += [f"first_joint = {quoted(arm.first_joint)}"]
    if without:
        told = ", ".join(map(quoted, without))
        lines += ["# Another arm of the cell has these, and all that they carry."]
        lines += [f"without = [{told}]"]
    return lines


def _drive(node: int, drive: DriveDraft, table: str) -> list[str]:
    unit, near = ("m", 0.005) if drive.prismatic else ("rad", 0.01)
    window = ["leash = 0.01"] if drive.prismatic else []
    if drive.rolls:
        window = ["leash = 0.1", "following_window = 0.3"]
    limits = (("lower", drive.lower), ("upper", drive.upper))
    return _block(
        "drive",
        drive=drive,
        node=node,
        table=table,
        notes=[f"# {CONFIRM}: {note}" for note in drive.notes],
        counts=1e7 if drive.prismatic else 1e5 if drive.rolls else 2086075.6701,
        limits=[f"{key} = {number(value)}" for key, value in limits if value is not None],
        rated=0.5 * drive.torque,
        unit=unit,
        margin=[] if drive.rolls else [f"position_margin = {near}"],
        stop=1.5 * drive.acceleration,
        window=window,
    )


def _capsules(draft: Draft, drafts: Sequence[Draft]) -> list[str]:
    """Return the capsules of an arm, and of what stands where it is the first."""
    lines: list[str] = []
    for fit in draft.fits:
        if draft is not drafts[0] and fit.link not in draft.arm.own:
            continue
        link, each = name_in(draft, drafts, fit.link), []
        held = ", ".join(quoted(name_in(draft, drafts, link)) for link in fit.holds)
        for i, (start, end, radius) in enumerate(fit.tubes):
            holds = [f"holds = [{held}]"] if held and i == 0 else []
            wide = math.ceil(1e4 * radius) / 1e4
            each += _block("capsule", link=link, start=start, end=end, radius=wide, holds=holds)
        tight = "flat" if math.isinf(fit.ratio) else f"{fit.ratio:.2f} times its hull's volume"
        lines += _block("shape", fit=fit, tight=tight, each=each)
    if draft.tool is not None:
        start, radius = draft.tool
        tip = name_in(draft, drafts, draft.arm.tip)
        tool = _block("capsule", link=tip, start=start, end=draft.mrf, radius=radius, holds=[])
        lines += _block("tool", each=tool)
    return lines


def name_in(draft: Draft, drafts: Sequence[Draft], link: str) -> str:
    """Return the name of a link in the cell: with several arms, its mechanism's before it."""
    if len(drafts) == 1:
        return link
    owner = draft if link in draft.arm.own else drafts[0]
    return f"{owner.arm.name}.{link}"


def _radius(draft: Draft) -> float:
    return 0.012 if draft.tool is None else draft.tool[1]


# --- Drives by their joints' limits in the URDF, and which of these cannot be meant ---------------
UNKNOWN_SPEED: Final = (0.5, 0.1)  # of a joint whose URDF says none
FASTEST: Final = (1.5, 0.25)
"""No joint is told to be faster, a prismatic one in metres [rad/s], [m/s]."""
QUICKEST: Final = 8.0  # no joint accelerates more [rad/s²]
STRONGEST: Final = 1e4  # greater torques in a URDF stand for none [N·m]
MEANT: Final = 20.0
"""A torque beyond so many times what holds all of the arm, stretched out, is doubted [1]."""
HOLDS: Final = 0.7  # part of a torque that gravity may take in postures that are used [1]
OFTEN: Final = 0.3  # a torque that holds the arm in fewer of all postures cannot be meant [1]
STOPS_S: Final = 0.4  # time in which the acceleration ends the greatest speed [s]


def cell_name(stem: str) -> str:
    """Return the name of a cell, by its file's."""
    name = re.sub(r"[^a-z0-9_]+", "_", stem.lower()).strip("_")
    return (name if name[:1].isalpha() else f"arm_{name}")[:32]


def limit_of(joint: ET.Element, key: str) -> float:
    """Return a joint's limit of that name, 0 where the URDF has none."""
    limit = joint.find("limit")
    return float(limit.get(key, "0")) if limit is not None else 0.0


def drive_of(joint: ET.Element) -> DriveDraft:
    """Return the drive of a joint, with a note at each limit that is missing or absurd."""
    kind, name = joint.get("type"), joint.get("name", "")
    prismatic = kind == "prismatic"
    speed = limit_of(joint, "velocity")
    notes = []
    if speed <= 0.0:
        notes.append(f"the URDF has no speed limit of {name}")
        velocity = UNKNOWN_SPEED[prismatic]
    else:
        velocity = min(0.5 * speed, FASTEST[prismatic])
    drive = DriveDraft(name, prismatic, max(velocity, 2e-3), 1.0, 1e5, notes=notes)
    if kind != "continuous":
        told = limits_of(limit_of(joint, "lower"), limit_of(joint, "upper"), prismatic=prismatic)
        if told is not None:
            drive.lower, drive.upper = told
            notes.append(f"the URDF's limits of {name} are missing, or wider than cables go")
    return drive


def range_of(joint: ET.Element, drive: DriveDraft) -> tuple[float, float]:
    """Return least and greatest position of a joint: its drive's, or else the URDF's."""
    if drive.lower is not None and drive.upper is not None:
        return drive.lower, drive.upper
    return limit_of(joint, "lower"), limit_of(joint, "upper")


def set_strength(
    drive: DriveDraft, joint: ET.Element, gravity: Array, inertia: float, stretched: float
) -> None:
    """Set torque, acceleration and speed of a drive.

    `stretched` is the torque [N·m], or force [N], that holds all of the arm at its reach. By the
    torques `gravity` (p,) that hold the arm in many postures, and the greatest inertia that
    the joint moves. A URDF's torque that holds the arm in some of them is kept.
    """
    effort, weight = limit_of(joint, "effort"), float(gravity.max(initial=0.0))
    drive.notes = [note for note in drive.notes if "torque limit" not in note]
    drive.torque = effort
    held = float((gravity <= HOLDS * effort).mean())
    if not 0.0 < effort <= STRONGEST or held < OFTEN:
        drive.torque = float(f"{3.0 * weight + 6.0 * inertia + 0.5:.2g}")
        why = "is missing, or absurd"
        if 0.0 < effort <= STRONGEST:
            why = f"is {effort:g}, and would not hold the arm, which takes {weight:.3g}"
        drive.notes.append(f"the URDF's torque limit of {drive.joint} {why}")
    elif weight > effort:
        drive.notes.append(
            f"the torque limit of {drive.joint}, {effort:g}, does not hold the arm everywhere: "
            f"stretched out it takes {weight:.3g}"
        )
    if drive.torque > MEANT * stretched:
        drive.notes.append(
            f"the torque limit of {drive.joint}, {effort:g}, is {effort / stretched:.0f} times "
            "what holds the whole arm stretched out: is it meant?"
        )
    taken = min(weight, HOLDS * drive.torque)
    spare = drive.torque - taken
    drive.acceleration = max(0.05, min(QUICKEST, 0.33 * spare / (1.3 * inertia + 5e-3)))
    drive.velocity = min(drive.velocity, max(2e-3, STOPS_S * drive.acceleration))


def limits_of(lower: float, upper: float, *, prismatic: bool) -> tuple[float, float] | None:
    """Return the limits to say where those of a URDF are missing or absurd, else None."""
    if prismatic:
        if lower >= upper:
            return 0.0, 0.3
        return (max(lower, -5.0), min(upper, 5.0)) if upper - lower > 10.0 else None
    if lower >= upper:
        return -3.0, 3.0
    if max(abs(lower), abs(upper)) > 2.0 * CONTINUOUS_RANGE:
        return max(lower, -CONTINUOUS_RANGE), min(upper, CONTINUOUS_RANGE)
    return None
