"""Keep the joints near a posture: whatever freedom the task leaves takes them there."""

from ....spatial import Array


def rate(q: Array, posture: Array) -> Array:
    """Return the joint rates (n,) from q to `posture` (n,) [rad], for a gain of 1 /s [rad/s]."""
    return posture - q
