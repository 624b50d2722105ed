"""Geotags, and the log in which an acknowledged one survives a crash and a full disk."""
