"""A mechanism's drives: tables for several, bounds of their joints, loops of virtual ones."""
