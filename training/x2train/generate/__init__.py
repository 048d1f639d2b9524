"""Sets of any size, the same on any number of workers: shards, worker pools, progress.

It imports no other room of x2train.
"""
