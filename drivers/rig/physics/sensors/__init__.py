"""Simulated sensors that look at the world: cameras, tags, the rays of a laser scanner."""
