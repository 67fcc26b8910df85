"""Pictures of cells for the documents."""
