"""The virtual world: physics, geometry, cameras."""
