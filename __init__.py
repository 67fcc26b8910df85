"""telerobot: an open control server for remote robot arms."""
