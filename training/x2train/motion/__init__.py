"""Recorded and animated motion: files become clips, clips become bodies that go along courses."""
