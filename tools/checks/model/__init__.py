"""Checks that need the arm's model: where it stands, and whether it starts."""
