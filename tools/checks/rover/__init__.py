"""Checks of a base on wheels, and of the laser scanner that looks ahead of it."""
