"""Recorded flights, one or many: a video and its log in, a folder with everybody who could be located out."""
