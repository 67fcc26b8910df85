"""Random scenes of obstacles."""
