"""Frames of an arm: the set in force, redefinition, and what is placed in them."""
