"""Generators: steps of a script that are no message, but motions over time or a network."""
