"""A scenario brought to life, flown and scored."""
