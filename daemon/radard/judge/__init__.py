"""What moves: features of a dwell, the bundle's network, evidence over windows, the decision."""
