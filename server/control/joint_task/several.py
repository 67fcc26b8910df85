"""The joint tasks of a cell, those of them that are on, and what they mean for the whole tick."""

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np

from ....config.load import Cell
from ..arm.arm import Arm
from ..barriers.together import PayloadLink
from ..spatial import Array
from ..state import Inputs, Memory, Output
from ..stop.limiter import Limiter
from ..stop.way_to_rest import Stop
from .joint_task import JointTask
from .members import Member, Together
from .stretch import Carried, Stretch
from .switch import held_together, let_go

LimiterOf = Callable[[tuple[tuple[int, ...], ...]], Limiter]
"""Builds the limiter of a cell in which the joints of groups of arms stop in proportion."""


class On(NamedTuple):
    """One joint task that is on, in one tick."""

    task: JointTask
    together: Together
    stretch: Stretch
    carried: Carried

    @property
    def stops(self) -> bool:
        """True while the arms may not move on: pressed too hard, or without the payload."""
        return self.together.strained is not None or self.together.slipped

    @property
    def link(self) -> PayloadLink:
        """Its arms, for the barriers."""
        ways = [member.give_way for member in self.together.members]
        return PayloadLink(np.array(self.task.members), np.array(ways))

    def shortfall(self, stop: Stop) -> float:
        """Return by how much a stop stretches the payload more than is promised [m]."""
        together = self.together
        return self.stretch.shortfall(stop, self.carried, together.grasps, together.giving_way)


class JointTasks:
    """The joint tasks of one cell."""

    def __init__(self, cell: Cell, arms: Sequence[Arm], limiter_of: LimiterOf) -> None:
        """Build them. Raises `ConfigError` where grasps do not fit at the start."""
        self.tasks = JointTask.of(cell, arms)
        self._stretches = [Stretch(cell, t.members, t.section.stretch) for t in self.tasks]
        self._limiter_of = limiter_of
        # Scratch: limiters by the arms whose joints are a group.
        self._limiters: dict[tuple[tuple[int, ...], ...], Limiter] = {}

    def seeded(
        self, memories: tuple[Memory, ...], q: Sequence[Array], on: Collection[str] | None
    ) -> tuple[Memory, ...]:
        """Return the memories of arms at rest, each at its q (n,), that hold payloads.

        Those of the tasks `on`; of those that are at start, if None.
        """
        for task in self.tasks:
            if task.section.at_start if on is None else task.name in on:
                memories = held_together(task, memories, q, always=True)
        return memories

    def on(self, memories: Sequence[Memory], inputs: Sequence[Inputs]) -> list[On]:
        """Return those that are on, with what they ask of their arms."""
        found = []
        for task, stretch in zip(self.tasks, self._stretches, strict=True):
            if task.on(memories):
                together = task.ask(memories, inputs)
                views = [member.inputs.settings.T_wrist_mrf for member in together.members]
                found.append(On(task, together, stretch, stretch.carried(views)))
        return found

    def switched(
        self, name: str, on: bool, memories: Sequence[Memory], q: Sequence[Array]
    ) -> tuple[Memory, ...]:
        """Return the memories of all arms once a task is on or off; `q` are measured joints (n,).

        Raises `HoldRefused` where that is not possible now, `KeyError` for a task that there is
        not.
        """
        task = {task.name: task for task in self.tasks}[name]
        if not on:
            return let_go(task, memories) if task.on(memories) else tuple(memories)
        return tuple(memories) if task.on(memories) else held_together(task, memories, q)

    def limiter(self, on: Sequence[On]) -> Limiter:
        """Return the limiter of a cell in which these tasks are on."""
        groups = tuple(each.task.members for each in on)
        if groups not in self._limiters:
            self._limiters[groups] = self._limiter_of(groups)
        return self._limiters[groups]


def members_of(on: Sequence[On]) -> dict[int, Member]:
    """Return the parts that arms have in joint tasks, by the arms' places."""
    return {
        i: member
        for each in on
        for i, member in zip(each.task.members, each.together.members, strict=True)
    }


def finish(
    on: Sequence[On],
    inputs: Sequence[Inputs],
    paces: Sequence[float],
    memories: list[Memory],
    outputs: list[Output],
) -> None:
    """Put what is common to the arms of each joint task into their memories and outputs."""
    for each in on:
        members = each.task.members
        found = each.task.finish(
            each.together,
            inputs[members[0]],
            [memories[i] for i in members],
            [outputs[i] for i in members],
            each.together.share * paces[members[0]],
        )
        for i, memory, output in zip(members, *found, strict=True):
            memories[i], outputs[i] = memory, output
