"""The operator's handle in a cell that reflects forces: its news, and the force that it is told."""

from ...config.schema.cell import CellConfig
from ...protocols.messages.reflection import Reflection, ReflectionRequest
from ..control.spatial import Array
from ..control.state import Output
from ..reflection.force_reflection import HandleEnergies, Reflector
from ..refusals import Refused, Why


class HapticHandle:
    """The handle of the lease's holder; without a reflector it feels nothing."""

    def __init__(self, reflector: Reflector | None) -> None:
        self.reflector = reflector

    def hear(self, energies: HandleEnergies | None, now_s: float, R_world_handle: Array) -> None:
        """Take in the energies that came with a command, and the axes (3, 3) of its frame."""
        if self.reflector is not None:
            self.reflector.hear(energies, now_s, R_world_handle)

    def protect(self) -> None:
        """Protect the reflected force against delay, as at start."""
        if self.reflector is not None:
            self.reflector.protected = True

    def set_protection(self, request: ReflectionRequest) -> None:
        """Protect the reflected force against delay, or not. Raises `Refused` if there is none."""
        if self.reflector is None:
            raise Refused(Why.NOT_NOW, "the cell reflects no forces")
        self.reflector.protected = request.protected

    def reflect(self, output: Output, scale: float, pursuing: bool) -> None:
        """Take in the wrench of a tick; `scale` is the clutch's, `pursuing`: a master's pose leads.

        Idle in a cell that reflects no forces.
        """
        if self.reflector is not None:
            self.reflector.reflect(
                output.wrench_mrf,
                output.gains,
                output.T_world_mrf_measured.R,
                scale,
                pursuing,
            )

    def message(self, tick: int) -> Reflection | None:
        """Return what the handle is told, None in a cell that reflects no forces."""
        return None if self.reflector is None else self.reflector.message(tick)


def reflector_of(config: CellConfig) -> Reflector | None:
    """Return what reflects forces in a cell; None where nothing does."""
    sensor = config.mechanism.force_torque
    if config.reflection is None or sensor is None:
        return None
    return Reflector(config.reflection, sensor.stiffest_environment, config.timing.period_s)
