"""Equipment of the documentation: what makes its tables, pages and pictures."""
