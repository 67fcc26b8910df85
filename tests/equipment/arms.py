"""The only arm of a URDF, as `telerobot init` reads it."""

from pathlib import Path

from telerobot.tools.init.robot import UrdfArm, read_arms


def read_arm(urdf: Path, tip: str | None, packages: dict[str, Path]) -> UrdfArm:
    return read_arms(urdf, [] if tip is None else [tip], packages)[0]
