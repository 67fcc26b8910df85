"""What arms run into, step by step of the physics, and which faults that explains.

A joint that meets something nobody told of, faster than the leash can stop it, falls behind its
command: a quick stop by the table of stops. Any other cause of a fault, and any fault that no touch
goes before, has another reason, whatever was touched earlier in the run.
"""

from typing import Final

from ...protocols.messages.telemetry import Event
from ..simulation.simulation import Simulation

FELT_N: Final = 5.0
"""Contact force from which a touch can hold a joint up [N]."""
SINCE_S: Final = 0.5
"""A fault so long after a touch is explained by it [s]."""
EXCUSED: Final = ("following_error",)
"""Causes of faults that a touch explains: the command and a joint come apart."""


class Touches:
    """Watches a simulation that is yet to run; takes its `on_physics`."""

    def __init__(self, simulation: Simulation) -> None:
        self.most_n = 0.0
        """Greatest force on what stands around, or between parts of arms [N]."""
        self._simulation = simulation
        self._times: list[float] = []
        simulation.on_physics = self._look

    @property
    def felt(self) -> bool:
        """True once a touch could hold a joint up."""
        return bool(self._times)

    def explain(self, event: Event) -> bool:
        """Return whether an event is a fault that a touch just before it explains."""
        if event.name != "fault" or event.values.get("cause") not in EXCUSED:
            return False
        return any(0.0 <= event.time_s - at_s <= SINCE_S for at_s in self._times)

    def unexplained(self) -> list[str]:
        """Return the errors of the run so far that no touch explains, a line each."""
        return [
            f"{event.name} at {event.time_s:.2f} s: {event.detail}"
            for event in self._simulation.events
            if event.severity == "error" and not self.explain(event)
        ]

    def _look(self, simulation: Simulation) -> None:
        force = simulation.rig.world.contacts.greatest()
        self.most_n = max(self.most_n, force)
        now_s = simulation.clock.time_s
        if force > FELT_N and (not self._times or now_s > self._times[-1]):
            self._times.append(now_s)
