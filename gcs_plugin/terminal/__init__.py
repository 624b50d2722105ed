"""The terminal of a program that flies: progress, Ctrl-C, and output that may be lost."""
