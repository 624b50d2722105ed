"""Scenarios: what is flown, what is seen and in which light, read from a TOML file."""
