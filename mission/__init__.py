"""Fly a drone past a target and estimate where the target is."""
