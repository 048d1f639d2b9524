"""People: how they are built, how they move, and what they do besides.

It may import `path`, `motion`, `skin` and, for the drawing of numbers they share, `flyer`.
"""
