"""Kinds of bodies: a serial arm, an arm on wheels; one on a curve has a room of its own."""
