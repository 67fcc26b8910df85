"""The virtual hardware in a cell file."""
