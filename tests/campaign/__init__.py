"""Behaviour at scale: random scripts, scenes and faults from a seed."""
