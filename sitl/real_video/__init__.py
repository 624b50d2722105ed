"""The tracker on real video: people whom nobody rendered, and whom no constant was chosen for."""
