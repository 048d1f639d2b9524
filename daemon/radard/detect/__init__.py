"""Does anything move, and where: clutter map, noise floor, gate, tracks, calibration."""
