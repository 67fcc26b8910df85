"""Checks of sampled loops: force, following, torque, reflection."""
