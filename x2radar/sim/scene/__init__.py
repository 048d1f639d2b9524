"""Scenes: what stands and moves before the radar, from YAML to scattering centres over time."""
