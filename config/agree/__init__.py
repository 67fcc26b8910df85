"""Agreement between sections of a cell."""
