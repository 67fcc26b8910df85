"""What must agree between sections of a cell."""
