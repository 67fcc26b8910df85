"""Force reflection: the force of the operator's handle, kept passive over a network."""
