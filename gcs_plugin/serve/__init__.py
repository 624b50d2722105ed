"""Waits for orders from ground stations and carries them out: one vehicle, or a fleet."""
