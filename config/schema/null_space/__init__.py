"""Potential field and control points in a cell file."""
