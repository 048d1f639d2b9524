"""The thesis' network on the daemon's features: the bundle `thesis`."""
