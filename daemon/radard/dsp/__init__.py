"""Signal processing: array in, array out, no state."""
