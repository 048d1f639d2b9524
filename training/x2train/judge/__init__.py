"""Bundles before suites of passages, in the daemon's own pipeline; and the reports of it.

The way down: table → verdicts → figures → report → page. It may import `x2train.sets`.
"""
