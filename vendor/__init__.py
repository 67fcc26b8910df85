"""Fetches what the console's page is served with, for builds; no part of the package."""
