"""Behaviour at scale: random scripts, scenes and faults from a seed."""

import os

# As for every command, and for workers that are spawned: before anything here imports NumPy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
