"""The robot description: read, judged, made plain; the chain, and the joints beside it."""
