"""The command line and what stands behind it: one small file per command."""
