"""Comparison with other libraries' collision avoidance in equal random scenes."""
