"""A simulated force-reflecting device as an operator's client, protected against delay."""
