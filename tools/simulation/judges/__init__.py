"""Judges of a simulated run: setpoints on the bus, tool, view, payload, tunnel."""
