"""Accuracy against the truth."""
