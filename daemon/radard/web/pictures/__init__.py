"""Pictures for a page: frames of the ring, or of a clip, to columns, to bytes."""
