"""Whether the ellipse is true for people as they walk."""
