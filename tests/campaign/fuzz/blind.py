"""Cameras without pictures, for runs that need none."""


class Blind:
    """Takes the place of a cell's rendered cameras."""

    def run(self, now_s: float, tick: int) -> None:
        """Take no pictures."""

    def close(self) -> None:
        """Have nothing to let go of."""
