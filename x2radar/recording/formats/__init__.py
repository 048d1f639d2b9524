"""Foreign recording formats: one file each, with a reader and, where it can, a `write`."""
