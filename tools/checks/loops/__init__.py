"""Judges of sampled loops: force, following, torque, reflection."""
