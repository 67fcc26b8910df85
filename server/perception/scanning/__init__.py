"""From the telegrams of a laser scanner to a contour ahead of the arm, and what to do about it."""
