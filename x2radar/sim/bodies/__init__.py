"""Bodies of people and animals that move with their feet on the floor."""
