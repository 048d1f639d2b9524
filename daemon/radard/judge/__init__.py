"""What moves: features of a dwell, the network of a bundle, evidence over windows, the decision.

It may import `radard.detect` and below.
"""
