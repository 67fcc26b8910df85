"""The loopback bus for python-can's own tools: `python -m can.viewer -i telerobot_loopback`.

An entry point of `can.interface`, so that can_logger, can_viewer, can_player, canopen and any
script see the frames between daemon and rig. The channel is the multicast group, `GROUP` or
`GROUP:PORT`; without one it is that of a cell that says nothing.
"""

from typing import Any

import can

from ..config.schema.bus import BusSection
from .bus import LoopbackBus


class LoopbackInterface(LoopbackBus):
    """One member of a loopback bus, by python-can's way of opening it."""

    def __init__(
        self,
        channel: str | None = None,
        port: int | None = None,
        can_filters: can.typechecking.CanFilters | None = None,
        receive_own_messages: bool = False,
        **_others: Any,
    ) -> None:
        """Open it; other options, as a bit rate, mean nothing here.

        Raises `CanInitializationError` for a group or a port that is none, and for own messages.
        """
        if receive_own_messages:
            raise can.CanInitializationError("telerobot_loopback: own messages are not received")
        default = BusSection()
        group, _, tail = (channel or default.channel).partition(":")
        try:
            number = int(tail or port or default.port)
        except ValueError:
            raise can.CanInitializationError(
                f"telerobot_loopback: channel {channel!r}: a multicast group, or GROUP:PORT"
            ) from None
        super().__init__(group, number)
        self.set_filters(can_filters)

    @staticmethod
    def _detect_available_configs() -> list[Any]:
        """Return the bus of a cell that says nothing of one: for `can.detect_available_configs`."""
        default = BusSection()
        channel = f"{default.channel}:{default.port}"
        return [{"interface": "telerobot_loopback", "channel": channel}]
