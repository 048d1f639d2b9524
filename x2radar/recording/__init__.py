"""Recordings: read, written, converted, described; blocks of frames are what all formats share.

`registry` opens a file by what it is. It may import `x2radar.device`, `settings` and `wire`.
"""
