"""Cameras that see nothing, for runs that are not about pictures."""


class Blind:
    """Takes the place of a cell's rendered cameras."""

    def run(self, now_s: float, tick: int) -> None:
        """Take no pictures."""

    def close(self) -> None:
        """Have nothing to let go of."""
