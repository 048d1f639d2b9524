"""Recordings judged after the fact: many at once, or one moment of one, explained.

It may import `radard.run`, `radard.web` and below; the commands `detect` and `why` use it.
"""
