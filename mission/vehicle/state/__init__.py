"""What an autopilot reports of itself, gathered from its messages."""
