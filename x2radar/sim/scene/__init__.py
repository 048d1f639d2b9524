"""Scenes: what stands and moves before the radar, from YAML to scattering centres over time.

`cast` names every body and thing that a scene may hold. It may import bodies, things and place.
"""
