"""Shapes of links: files of meshes, triangles, and the capsules around them."""
