"""Flight recorder: the tick's inputs, memories and outputs as bytes, and the black box."""
