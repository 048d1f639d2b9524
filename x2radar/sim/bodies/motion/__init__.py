"""What motion generators share: phase along a path, footprints, two-link limbs, joint curves.

A motion says where the segments of a body are, a skin how they echo; any of one goes with any of
the other. There are three generators for people and for four-legged animals: `gait` (with its
`path` and `footfalls`), footfalls with inverse kinematics, joint angles; and recorded motion. This
room may import `path`.
"""
