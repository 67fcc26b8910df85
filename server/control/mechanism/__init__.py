"""A mechanism: kinematics, dynamics, and the resolution of a twist into joint rates."""
