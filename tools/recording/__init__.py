"""Recorded runs: recording, replay, export, playback, and pictures of them."""
