"""Simulated people: bodies, gaits, and where they walk."""
