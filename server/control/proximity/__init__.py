"""Distances: capsules around the links, near pairs, and bounds on how close they may come."""
