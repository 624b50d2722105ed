"""Let a ground station ask for a location, and bring the answer back."""
