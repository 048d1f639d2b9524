"""Signal processing: array in, array out; what streams keeps its own few frames, no more."""
