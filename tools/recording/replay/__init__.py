"""Replay of recorded ticks, bit by bit."""
