"""Distances: capsules around the links, pairs of what is near, and how near they may come."""
