"""A bundle that learns one's own pet: clips, guard, light retraining."""
