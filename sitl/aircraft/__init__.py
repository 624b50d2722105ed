"""What simulated aircraft have in common: their process, their sockets, the truth of their flight."""
