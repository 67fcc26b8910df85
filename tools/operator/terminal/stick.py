"""Stick made of held keys: a twist of the tool, or rates of one joint. Pure."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from ....protocols.messages.messages import Frame

AXES = {
    "w": (0, 1.0), "s": (0, -1.0), "a": (1, 1.0), "d": (1, -1.0), "r": (2, 1.0), "f": (2, -1.0),
    "u": (3, 1.0), "o": (3, -1.0), "i": (4, 1.0), "k": (4, -1.0), "j": (5, 1.0), "l": (5, -1.0),
}  # fmt: skip
"""Key: axis of the twist (0 to 5), and its sign."""

JOINT_SIGNS = {"[": -1.0, "]": 1.0, "left": -1.0, "right": 1.0, "down": -1.0, "up": 1.0}
"""Key: direction in which the chosen joint moves."""

DRIVES = {"v": 1.0, "b": -1.0}
"""Key: direction in which an arm in tunnels is driven along, or a base."""

TURNS = {",": 1.0, ".": -1.0}
"""Key: direction in which a base on wheels turns, to the left and to the right."""

BASE_PER_TOOL = 2.0
"""A base is driven so much faster than the tool [1]."""

SPEEDS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Stick speeds to choose from [m/s]."""

TURN_PER_METRE = 4.0
"""Angular stick speed for each linear one [rad/m]."""

FRAMES = (Frame.CRF, Frame.MRF, Frame.BASE, Frame.WORLD)


def opposites(key: str) -> tuple[str, ...]:
    """Return the keys that move the other way along the same axis."""
    if key in AXES:
        axis, sign = AXES[key]
        return tuple(k for k, other in AXES.items() if other == (axis, -sign))
    if key in DRIVES:
        return tuple(k for k in DRIVES if k != key)
    if key in TURNS:
        return tuple(k for k in TURNS if k != key)
    return tuple(k for k, sign in JOINT_SIGNS.items() if sign == -JOINT_SIGNS.get(key, 0.0))


@dataclass
class Stick:
    """Choices of the operator: speed, frame, and one joint or the tool."""

    level: int = 3
    frame: Frame = Frame.CRF
    joint: int | None = None
    """Number of the joint that is jogged, counted from 0; None moves the tool."""

    @property
    def speed(self) -> float:
        """Linear speed of the tool [m/s]."""
        return SPEEDS[self.level]

    @property
    def turn(self) -> float:
        """Angular speed of the tool, or of the jogged joint [rad/s]."""
        return TURN_PER_METRE * self.speed

    def faster(self, steps: int) -> None:
        """Choose a higher speed, or a lower one with negative steps."""
        self.level = min(max(self.level + steps, 0), len(SPEEDS) - 1)

    def next_frame(self) -> None:
        """Use the axes of the next frame."""
        self.frame = FRAMES[(FRAMES.index(self.frame) + 1) % len(FRAMES)]

    def twist(self, held: Collection[str]) -> tuple[float, ...]:
        """Return the twist (6,) [m/s, rad/s] of the keys that are held."""
        twist = [0.0] * 6
        for key in held:
            if key in AXES:
                axis, sign = AXES[key]
                twist[axis] += sign * (self.speed if axis < 3 else self.turn)
        return tuple(twist)

    def insertion(self, held: Collection[str], most: float) -> float:
        """Return the insertion speed of the keys that are held, at most `most` either way [m/s]."""
        return sum(DRIVES.get(key, 0.0) for key in held) * min(self.speed, most)

    def drive(self, held: Collection[str], base: Mapping[str, float]) -> tuple[float, float]:
        """Return at which v [m/s] and ω [rad/s] held keys drive a base, within its own."""
        ahead = sum(DRIVES.get(key, 0.0) for key in held)
        turn = sum(TURNS.get(key, 0.0) for key in held)
        return (
            ahead * min(BASE_PER_TOOL * self.speed, base["speed"]),
            turn * min(BASE_PER_TOOL * self.turn, base["angular_speed"]),
        )

    def rates(self, held: Collection[str], max_velocity: Sequence[float]) -> tuple[float, ...]:
        """Return joint rates (n,) [rad/s] of the keys that are held, within (n,) bounds."""
        rates = [0.0] * len(max_velocity)
        signs = {JOINT_SIGNS[key] for key in held if key in JOINT_SIGNS}
        if self.joint is not None and self.joint < len(rates):
            bound = max_velocity[self.joint]
            rates[self.joint] = sum(signs) * min(self.turn, bound)
        return tuple(rates)
