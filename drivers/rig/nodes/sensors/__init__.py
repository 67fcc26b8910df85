"""Simulated sensors: force/torque sensor with its cross-talk, laser scanner."""
