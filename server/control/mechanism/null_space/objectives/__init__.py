"""Redundancy objectives: each asks for joint rates; their sum is projected to the null space."""
