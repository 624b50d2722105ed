"""A flight's folder and its pictures."""
