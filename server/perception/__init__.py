"""Perception: obstacles, moving frames, cameras, force/torque, contact."""
