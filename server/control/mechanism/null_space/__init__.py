"""The null space: redundancy objectives, the potential field, control points."""
