"""Sections of the sources: who may ask the tool for a rate, one file each."""
