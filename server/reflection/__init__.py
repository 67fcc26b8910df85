"""Force reflection: what the operator's handle pushes with, kept passive over a network."""
