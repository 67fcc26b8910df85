"""Potential fields (Scott & Carignan): what the spare freedoms slide downhill in."""
