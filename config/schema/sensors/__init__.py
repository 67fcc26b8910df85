"""Schema of the sensors that look about: cameras, laser scanner."""
