"""Windows: what the daemon's own code makes of passages, kept in sets and read back.

It may import `x2train.scenarios` and `x2train.generate`.
"""
