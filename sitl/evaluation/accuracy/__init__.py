"""Accuracy against the truth: simulated flights at the level of sightings, the field's methods beside each other."""
