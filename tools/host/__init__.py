"""This machine: what it grants, where processes are found, and a plant of its own."""
