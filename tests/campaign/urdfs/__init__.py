"""Arms that others published, from their URDFs to motion."""
