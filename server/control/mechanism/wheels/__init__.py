"""Joint rates of an arm on a base with wheels."""
