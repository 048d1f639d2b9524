"""Bundles before suites of passages, in the daemon's own pipeline.

It may import `x2train.sets`, `windows`, `report` and `generate`.
"""
