"""The field's other methods, on the same sightings."""
