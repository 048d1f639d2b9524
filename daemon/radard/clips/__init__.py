"""Clips: the frames around an alarm, kept as a recording, and their picture.

It may import `radard.dsp` and below.
"""
