"""What guided motions tell: payload and sensor, and what a tool touches. Pure."""
