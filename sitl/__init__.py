"""Simulated drones, cameras and people: scripted missions, met only over the wire."""
