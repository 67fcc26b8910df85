"""Scripts: what operators do over time, and how that is played."""
