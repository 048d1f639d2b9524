"""Clips: the frames around an alarm, kept as a recording, and their picture."""
