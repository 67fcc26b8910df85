"""Schema of a CAN bus, and of what every device on one has."""
