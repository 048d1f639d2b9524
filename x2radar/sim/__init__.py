"""The simulated module: bodies, scenes, receiver and the far end of the byte protocol."""
