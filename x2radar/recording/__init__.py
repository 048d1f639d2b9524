"""Recordings: read, written, converted, described; blocks of frames are what all formats share."""
