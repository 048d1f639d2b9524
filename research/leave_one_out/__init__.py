"""Leave one simulator out: what a network makes of a law of motion or echo that it never saw."""
