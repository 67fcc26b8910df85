"""Messages of force reflection: the force for the operator's handle, and energies.

The envelope, units and conventions are those of `messages.py`.
"""

from .messages import Count, Identifier, Message, TaskCommand, Vector6


class Reflection(Message):
    """Force of the operator's handle on the hand, every tick (Williams 1997, eq. 6).

    `wrench` [N, N·m] is −K_FR times the MRF's wrench, in the axes that the newest stick or
    master's pose is expressed in: a device makes it with the joint torques `J_HCᵀ wrench`. It is
    for a handle with a `protected` loop unless somebody switched that off.

    `slope` [N·s/m] is the steady force for each rate of the stick, K_FR K_HC / K_F: with the
    handle's own speed per force it makes the loop's gain. `entered` [J] is the energy that the
    arm's port has put into the network so far; it never falls.
    """

    tick: Count
    wrench: Vector6
    slope: float
    entered: float
    protected: bool
    task: Identifier | None = None
    """Whose force it is; None: of the first task, or the only one."""


class ReflectionRequest(TaskCommand):
    """Switches the protection of force reflection against delay off, or on again.

    For experiments: off, a distant handle may bounce. Enabling the arm switches it on.
    """

    protected: bool
