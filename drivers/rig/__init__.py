"""The virtual hardware: physics, and one simulated CAN node per file."""
