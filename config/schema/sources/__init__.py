"""Sections of the sources, one file each: who may ask the tool for a rate, and gain schedules."""
