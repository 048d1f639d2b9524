"""Four-legged animals: build, gait, what they do on the floor, and jumps.

It may import `path`, `motion`, `skin` and, for the drawing of numbers they share, `flyer`.
"""
