"""From a trained network to the files that the daemon loads, and the recipes of the shipped ones.

It may import `x2train.nets` and `x2train.judge`, and what is below them.
"""
