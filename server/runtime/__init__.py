"""Time and what happened: the daemon's clock, and its events."""
