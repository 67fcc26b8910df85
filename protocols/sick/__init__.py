"""Telegrams of SICK's laser scanners."""
