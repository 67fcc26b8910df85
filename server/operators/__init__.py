"""Operators: the network, the lease, admission, and answers to requests."""
