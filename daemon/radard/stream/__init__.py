"""From a port to dwells: sources of frames, playback, the ring that marks gaps.

It may import `radard.config` and below.
"""
