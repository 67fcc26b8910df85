"""A task: its sources, each a twist of the MRF, their gains and their sum; it knows no joints."""
