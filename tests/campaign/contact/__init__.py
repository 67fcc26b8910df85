"""Contact: touch, letting go, sliding, pegs, force reflection."""
