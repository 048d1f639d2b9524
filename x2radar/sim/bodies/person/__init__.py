"""People: how they are built, how they move, and what they do besides.

It may import `path`, `rcs` and, for the drawing of numbers they share, `flyer`.
"""
