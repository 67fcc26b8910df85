"""Teleoperation from a keyboard."""
