"""Units: what the daemon keeps for each arm of a cell and its task."""
