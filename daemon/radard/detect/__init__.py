"""Does anything move, and where: clutter map, noise floor, gate, tracks, calibration.

It may import `radard.dsp` and `radard.stream`.
"""
