"""A public benchmark: simulated recorded flights, and the score of any program's GeoJSON answers to them."""
