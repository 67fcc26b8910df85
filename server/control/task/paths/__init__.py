"""Motions that the position source follows: what they lead to, and where they are now."""
