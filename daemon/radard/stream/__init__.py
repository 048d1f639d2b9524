"""From a port to dwells: sources of frames, playback, the ring that marks gaps."""
