"""Soak: hostile operators against one cell, in virtual time."""
