"""The recorded walks against simulated ones: the same processing, the same numbers."""
