"""Recorded runs, and pictures of them."""
