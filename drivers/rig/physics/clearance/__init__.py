"""Clearance in truth: the arm's distances from what stands about it, and from lines of sight."""
