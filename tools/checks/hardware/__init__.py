"""Checks of the buses over SDO: what is there, and whether it keeps CiA 301 and 402-2."""
