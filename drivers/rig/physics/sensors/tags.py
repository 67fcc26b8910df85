"""The planar tags of the virtual world: where they are, and which are covered."""

from collections.abc import Sequence

from .....config.schema.sensors.cameras import RigTagSection
from .....protocols.messages.messages import Vector6
from .....protocols.messages.rig import RigFault
from ...fault_values import FARTHEST, vector_of

KINDS = ("cover", "move")
"""Kinds of faults whose target is a tag."""


class Tags:
    """Effects of faults on a rig's tags."""

    def __init__(self, tags: Sequence[RigTagSection]) -> None:
        self._home: dict[str, Vector6 | None] = {}
        for tag in tags:
            place = tag.T_world_tag
            self._home[tag.name] = None if place is None else (*place.xyz, *place.rpy)
        self._moved: dict[str, Vector6] = {}
        self._covered: set[str] = set()

    @property
    def covered(self) -> tuple[str, ...]:
        """Names of the tags that nobody can see now."""
        return tuple(sorted(self._covered))

    @property
    def poses(self) -> dict[str, Vector6]:
        """Where each tag that stands in World is now: x, y, z [m], roll, pitch, yaw [rad]."""
        standing = {name: pose for name, pose in self._home.items() if pose is not None}
        return standing | self._moved

    def inject(self, fault: RigFault) -> None:
        """Cover or move a tag, or take that back. Raises `ValueError`, in one line."""
        name = fault.target
        if name not in self._home:
            known = ", ".join(self._home) or "none"
            raise ValueError(f"fault {fault.kind}: no tag {name!r}; there are {known}")
        if fault.kind == "cover":
            (self._covered.add if fault.on else self._covered.discard)(name)
            return
        home = self._home[name]
        if home is None:
            raise ValueError(f"fault move: the arm carries tag {name}")
        if not fault.on:
            self._moved.pop(name, None)
        else:
            x, y, z = vector_of(fault, FARTHEST, "m").tolist()
            self._moved[name] = (x, y, z, *home[3:])
