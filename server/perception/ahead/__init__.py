"""The contour ahead of an arm on a base, as it is told."""
