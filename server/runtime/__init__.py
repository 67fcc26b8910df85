"""Runtime: the daemon's clock, its events, and what it asks of the operating system."""
