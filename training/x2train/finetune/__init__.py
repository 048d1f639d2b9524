"""A bundle that learns one's own pet: clips, guard, verifier, light retraining."""
