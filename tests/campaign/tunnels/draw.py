"""Draws of the part `tunnel`: tunnels, gaps between them, drives, and the operator's acts."""

import math

import numpy as np
from laboratory.oracle.passable import passable
from laboratory.oracle.poses import rotation
from laboratory.oracle.tunnel import Tunnel
from telerobot.config.load import Cell, altered
from telerobot.config.schema.mechanism import BackboneSection, SegmentSection
from telerobot.config.schema.section import PoseSection
from telerobot.server.control.backbone.insertion import Backbone
from telerobot.tools.scripts.script import Script
from telerobot.tools.soak.segments import Act, Draw

END_S = 6.0
"""Length of a run [s]."""
ACT_S = (0.3, 1.2)
"""Length of one act of the operator [s]."""
LINK, JOINTS, MOST, THICKNESS = 0.05, 30, 1.04, 0.01
"""Length of a link [m], joints [1], their range [rad] and the walls' thickness [m]."""
RADIUS = ((0.09, 0.25), (0.19, 0.40))
"""Of bends, planar and in space [m]."""
TUNNELS = 400
"""So many tunnels are drawn before a gap is given up [1]."""


def tunnel(section: BackboneSection, draw: Draw) -> BackboneSection:
    """Return a section with tunnels that the arm can go through, in two of five with a gap."""
    gap = draw.random() < 0.4
    while True:
        for _ in range(TUNNELS):
            made = _drawn(section, draw, gap)
            if passable(made, LINK, LINK * JOINTS, MOST, THICKNESS, np.zeros(3)):
                return made
        gap = False


def _drawn(section: BackboneSection, draw: Draw, gap: bool) -> BackboneSection:
    planar, pieces = section.axes == "planar", list[SegmentSection]()
    while sum(piece.length for piece in pieces) < LINK * JOINTS - section.least + 0.1:
        if gap and pieces and sum(piece.length for piece in pieces) > 0.15:
            pieces.append(_gap(section, pieces, draw, planar))
            gap = False
        radius = float(draw.uniform(*RADIUS[not planar]))
        angle = float(draw.uniform(0.3, 3.0 if planar else 1.6)) * float(draw.choice((-1, 1)))
        climbs = not planar and draw.random() < 0.5
        turn = {"climb": angle} if climbs else {"bend": angle}
        pieces.append(SegmentSection(length=radius * abs(angle), **turn))
        if draw.random() < 0.3:
            pieces.append(SegmentSection(length=float(draw.uniform(0.05, 0.2))))
    return section.model_copy(update={"tunnel": tuple(pieces)})


def _gap(
    section: BackboneSection, pieces: list[SegmentSection], draw: Draw, planar: bool
) -> SegmentSection:
    """Return a gap, and where the next tunnel begins beyond it."""
    R, p = Tunnel(section.model_copy(update={"tunnel": tuple(pieces)})).end
    chord = float(draw.uniform(0.2, 0.45))
    aside, turned = draw.uniform(-0.3, 0.3, 2), draw.uniform(-1.0, 1.0, 2)
    if planar:
        aside[1] = turned[1] = 0.0
    way = np.array([1.0, *aside])
    p = p + R @ way * (chord / float(np.linalg.norm(way)))
    R = R @ rotation(np.array([0.0, -turned[1], turned[0]]))
    rpy = (
        math.atan2(R[2, 1], R[2, 2]),
        -math.asin(min(1.0, max(-1.0, R[2, 0]))),
        math.atan2(R[1, 0], R[0, 0]),
    )
    x, y, z = p.tolist()
    return SegmentSection(
        length=chord * float(draw.uniform(1.02, 1.25)), to=PoseSection(xyz=(x, y, z), rpy=rpy)
    )


def drives(cell: Cell, draw: Draw) -> Cell:
    """Return the cell with other gains and friction behind its simulated drives."""
    rig = cell.config.rig
    if rig is None:
        return cell
    # Faster or slower loops of the same shape: what they take of integral grows with the cube.
    f, friction = float(draw.uniform(0.75, 1.3)), float(draw.uniform(0.3, 3.0))
    integral, damping = float(draw.uniform(0.3, 1.0)), float(draw.uniform(1.0, 1.3))
    drive = rig.drive
    drive = drive.model_copy(
        update={
            "stiffness": tuple(f**2 * x for x in drive.stiffness),
            "damping": tuple(damping * f * x for x in drive.damping),
            "integral": tuple(integral * f**3 * x for x in drive.integral),
            "friction": tuple(friction * x for x in drive.friction),
        }
    )
    rig = rig.model_copy(update={"drive": drive})
    return altered(cell, {"rig": rig})


def generate(cell: Cell, seed: int) -> tuple[Cell, Script]:
    """Return the cell and the script of a seed; equal seeds give equal runs.

    Raises `ConfigError` where the server takes no tunnel that the judge accepted.
    """
    draw = np.random.default_rng([seed, 11])
    mechanism = cell.config.mechanism
    section = mechanism.backbone
    if section is None:
        raise ValueError(f"cell {cell.config.name} has no backbone")
    section = tunnel(section, draw)
    cell = _with(drives(cell, draw), section, mechanism.postures["start"])
    backbone = Backbone.from_cell(cell)
    if backbone is None:
        raise ValueError(f"cell {cell.config.name} has no backbone")
    place = int(draw.integers(len(backbone.lengths)))
    cell = _with(cell, section, tuple(backbone.fits[place].tolist()))
    deepest = backbone.chain.length - section.least
    return cell, Script.model_validate({"duration_s": END_S, "step": _acts(section, deepest, draw)})


def _with(cell: Cell, section: BackboneSection, q: tuple[float, ...]) -> Cell:
    postures = {"start": q, "ready": q}
    return altered(cell, {"mechanism.backbone": section, "mechanism.postures": postures})


def _acts(section: BackboneSection, deepest: float, draw: Draw) -> list[Act]:
    """Return what the operator does, one act after the other, each of any length."""
    steps: list[Act] = []
    at_s, speed = 0.2, 0.0
    kinds = ("drive",) * 4 + ("reverse",) * 3 + ("insert", "stick", "hold", "stop", "slow", "gain")
    while at_s < END_S - 0.3:
        kind = str(draw.choice(kinds)) if steps else "drive"
        if kind in ("drive", "reverse"):
            to = float(draw.uniform(0.3, 1.0) * draw.choice((-1, 1))) * section.speed
            speed = to if kind == "drive" else -math.copysign(section.speed, speed)
            steps.append({"at_s": at_s, "cmd/drive": {"rates": [speed]}})
        elif kind == "insert":
            steps.append({"at_s": at_s, "cmd/insert": {"depth": float(draw.uniform(0, deepest))}})
        elif kind == "stick":
            twist = [*draw.uniform(-0.15, 0.15, 3).tolist(), *draw.uniform(-0.5, 0.5, 3).tolist()]
            stick = {"twist": twist, "expressed_in": "mrf"}
            steps.append({"at_s": at_s, "for_s": 0.5, "cmd/joystick": stick})
        elif kind == "slow":
            factor = float(draw.uniform(0.2, 1.0))
            steps.append({"at_s": at_s, "operator/speed": {"factor": factor}})
        elif kind == "gain":
            gain = draw.uniform(0.0, 2.0, 6).tolist()
            steps.append({"at_s": at_s, "operator/gain": {"source": "joystick", "gain": gain}})
        else:
            still_s = float(draw.uniform(0.3, 0.8))
            if kind == "hold":
                steps.append({"at_s": at_s, "operator/mode": {"action": "hold"}})
            else:
                steps.append({"at_s": at_s, "operator/protective_stop": {}})
                steps.append({"at_s": at_s + still_s, "operator/protective_clear": {}})
            steps.append({"at_s": at_s + still_s + 0.02, "operator/mode": {"action": "resume"}})
            at_s += still_s
        at_s += float(draw.uniform(*ACT_S))
    if draw.random() < 0.2:
        joint, kind = int(draw.integers(JOINTS)), str(draw.choice(("fault", "silence", "block")))
        fault = {"kind": kind, "target": f"j{joint + 1}"}
        steps.append({"at_s": float(draw.uniform(1.0, END_S - 1.0)), "rig/fault": fault})
    return sorted(steps, key=lambda step: float(step["at_s"]))
