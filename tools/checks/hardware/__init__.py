"""Checks of what is on the buses: read over SDO, compared with the cell, nothing moved."""
