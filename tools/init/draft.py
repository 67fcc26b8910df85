"""Draft of a cell while `init` makes it, and the text of its file."""

import math
from dataclasses import dataclass, field

from .robot import UrdfArm
from .shape.shapes import Array
from .toml_text import bound, number, numbers, plain, quoted

CONFIRM = "CONFIRM"
"""Begins every comment at something that must be confirmed."""


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

    @property
    def jerk(self) -> float:
        """Conservative jerk: the acceleration is reached in a period [rad/s³]."""
        return min(100.0 * self.acceleration, 50_000.0)


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
    stiffness: tuple[float, float] = (20_000.0, 500.0)
    wall: tuple[Array, Array, float] | None = None
    """Centre of its face, normal, and half its side."""
    reach: float = 1.0
    """How far from Base the tool gets [m]."""
    singular_region: float = 0.05
    length: float = 0.3
    """Weighs radians against metres [m]."""
    push: float = 10.0
    """Force of the default script on the wall [N]."""
    port: int = 43210


def text_of(draft: Draft) -> str:
    """Return the cell file."""
    arm = draft.arm
    lines = [
        f"# {draft.name}: made by `telerobot init {arm.urdf.name}`. It runs as it is on virtual",
        "# hardware. Before a real arm moves by it, look at every line that says "
        f"{CONFIRM}, and go through",
        "# config/guides/own_arm.md: `telerobot check` judges the file, `check --bus` the drives.",
        "",
        f'name = "{draft.name}"',
        f'description = "{draft.name}, from {plain(arm.urdf.name)}"',
        f'default_script = "{draft.script}"',
        "",
        "[bus]",
        f'# {CONFIRM}: "socketcan" and a channel as "can0" for real drives.',
        'interface = "loopback"',
        'channel = "239.74.163.10"',
        f"port = {draft.port}",
        "",
        "[mechanism]",
        'name = "arm"',
        f"urdf = {quoted(draft.urdf)}",
        f"# {CONFIRM}: the link that the tool is bolted to.",
        f"tip_link = {quoted(arm.tip)}",
        f"# {CONFIRM}: the greatest mass that the arm carries there [kg]; by the drives' torques.",
        f"rated_payload = {bound(draft.rated)}",
        f"# {CONFIRM}: the point that is moved, as seen from that link: here the ball of the rig.",
        f"T_wrist_mrf = {{ xyz = {numbers(draft.mrf)} }}",
    ]
    if arm.held:
        lines += ["# Held at zero, as no part of the arm: " + ", ".join(arm.held) + "."]
    lines += ["", "[mechanism.postures]"]
    lines += [f"# {CONFIRM}: nothing of the real cell is in the way. Found by a search: free of"]
    lines += ["# collision with the arm itself, and away from singularities and limits."]
    lines += [f"{name} = {numbers(q)}" for name, q in draft.postures.items()]
    if arm.inertials:
        lines += [""]
        lines += [
            "# Estimated from shapes, where the URDF has no mass or inertia, or none of a body:"
        ]
    for given in arm.inertials:
        I = given.inertia  # noqa: E741  the field's symbol
        lines += [
            f"# {CONFIRM}: weigh it, or ask its maker. {plain(given.why)}.",
            "[[mechanism.inertials]]",
            f"link = {quoted(given.link)}",
            f"mass = {number(given.mass)}",
            f"com = {numbers(given.com)}",
            "inertia = "
            + numbers([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]], digits=6),
            "",
        ]
    lines += _sensor(draft)
    lines += [
        "",
        f"# {CONFIRM} of every drive: node, direction, counts and zero, one joint at a time.",
        "# Speeds are half of the URDF's at most, accelerations by a third of the torque.",
    ]
    for node, drive in enumerate(draft.drives, start=1):
        lines += _drive(node, drive)
    lines += _control(draft)
    return "\n".join(lines) + "\n"


def _sensor(draft: Draft) -> list[str]:
    return [
        "",
        f"# {CONFIRM}: a force/torque sensor between the arm and its tip link. Delete the section",
        "# (and sources.force, rig.force_torque) where there is none: nothing then gives way.",
        "[mechanism.force_torque]",
        'device = "robotous"',
        "rate_hz = 200",
        f"# {CONFIRM}: what hangs on it, here by the URDF; `telerobot identify` finds it out.",
        f"payload = {{ mass = {number(draft.payload)}, com = {numbers(draft.com)} }}",
        f"# {CONFIRM}: the stiffest things that it will touch [N/m], [N·m/rad].",
        f"stiffest_environment = {number(draft.stiffness[0])}",
        f"stiffest_environment_rotation = {number(draft.stiffness[1])}",
    ]


def _drive(node: int, drive: DriveDraft) -> list[str]:
    unit, near = ("m", 0.005) if drive.prismatic else ("rad", 0.01)
    lines = ["", *(f"# {CONFIRM}: {note}" for note in drive.notes), "[[mechanism.drives]]"]
    lines += [f"joint = {quoted(drive.joint)}", f"node = {node}"]
    counts = 1e7 if drive.prismatic else 2086075.6701
    lines += [f"counts_per_radian = {counts}", "direction = 1", "zero_rad = 0.0"]
    for key, value in (("lower", drive.lower), ("upper", drive.upper)):
        lines += [] if value is None else [f"{key} = {number(value)}"]
    lines += [
        f"rated_torque = {bound(0.5 * drive.torque)}",
        f"max_torque = {bound(drive.torque)}",
        f"max_velocity = {bound(drive.velocity)}  # [{unit}/s]",
        f"max_acceleration = {bound(drive.acceleration)}",
        f"max_jerk = {bound(drive.jerk)}",
        f"position_margin = {near}",
        f"quick_stop_deceleration = {number(1.5 * drive.acceleration)}",
    ]
    if drive.prismatic:
        lines += ["leash = 0.01", "following_window = 0.02"]
    return lines


def _control(draft: Draft) -> list[str]:
    linear, angular = (number(g) for g in draft.gain)
    speed = min(0.25, 0.3 * draft.reach)
    lines = [
        "",
        "[sources.position]",
        f"speed = {number(min(0.15, 0.2 * draft.reach))}",
        "",
        "[sources.force]",
        "# Force to speed [m/s/N], moment to turning [rad/s/N·m]; `check` judges.",
        f"gain = [{linear}, {linear}, {linear}, {angular}, {angular}, {angular}]",
        "",
        "[limits]",
        f"# {CONFIRM}: the tool is never faster [m/s].",
        f"speed = {number(speed)}",
        "angular_speed = 1.0",
        "",
        "[resolve]",
        "# By the arm's size: radians weigh as metres by this, and damping begins at that.",
        f"characteristic_length = {number(draft.length)}",
        f"singular_region = {number(draft.singular_region)}",
        f"damping = {number(0.4 * draft.singular_region)}",
        f"floor = {number(0.2 * draft.singular_region)}",
        "",
        "# Links keep clear of each other, and of [[obstacles]]. Tell it what stands around:",
        "# [[obstacles]]",
        '# name = "table"',
        '# shape = "box"',
        "# xyz = [0.5, 0.0, -0.05]",
        "# half_size = [0.4, 0.4, 0.05]",
        "[avoidance]",
        "enabled = true",
        "clearance = 0.02",
        "self_clearance = 0.005",
    ]
    if draft.contacts:
        lines += ["# These overlap, or nearly, wherever the arm is.", "allowed_contacts = ["]
        lines += [f"  {{ link = {quoted(a)}, other = {quoted(b)} }}," for a, b in draft.contacts]
        lines += ["]"]
    for fit in draft.arm.fits:
        tight = "flat" if math.isinf(fit.ratio) else f"{fit.ratio:.2f} times its hull's volume"
        lines += ["", f"# Around {fit.source}: {tight}."]
        for tube in fit.tubes:
            lines += [
                "[[avoidance.capsules]]",
                f"link = {quoted(fit.link)}",
                f"start = {numbers(tube.start)}",
                f"end = {numbers(tube.end)}",
                f"radius = {number(math.ceil(1e4 * tube.radius) / 1e4)}",
            ]
    if draft.tool is not None:
        start, radius = draft.tool
        lines += [
            "",
            f"# {CONFIRM}: the tool, here the stalk and the ball of the rig.",
            "[[avoidance.capsules]]",
            f"link = {quoted(draft.arm.tip)}",
            f"start = {numbers(start)}",
            f"end = {numbers(draft.mrf)}",
            f"radius = {number(radius)}",
        ]
    return lines + _rig(draft)


def _rig(draft: Draft) -> list[str]:
    radius = 0.012 if draft.tool is None else draft.tool[1]
    lines = [
        "",
        "# The virtual hardware; the daemon never reads it. Delete it where the drives are real.",
        "# What [rig.drive] does not say comes from the arm's inertia.",
        "[rig]",
        "seed = 1",
        f"tool_radius = {number(radius)}",
    ]
    if draft.wall is not None:
        centre, normal, half = draft.wall
        lines += [
            "",
            "[rig.wall]",
            f"xyz = {numbers(centre)}",
            f"normal = {numbers(normal, digits=6)}",
            f"half_size = {number(half)}",
            f"stiffness = {number(draft.stiffness[0])}",
            "damping = 300.0",
            "mass = 1.0",
        ]
    return lines
