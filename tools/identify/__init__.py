"""Identification of payload, sensor bias, mounting and cross-talk by a guided motion."""
