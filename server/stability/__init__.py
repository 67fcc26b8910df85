"""Stability of the sampled loops: force, following, torque, gains and payloads."""
