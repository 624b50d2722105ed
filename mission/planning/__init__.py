"""The pattern for a wanted accuracy, and the bound that any estimate from it has."""
