"""Motions: where the parts of a body are at any time; any of them goes with any skin.

People and four-legged animals have three generators each, so that a network cannot learn one by
heart: published strides (`people.gait`, `quadrupeds.gait`), drawn ones (`people.footfalls`),
joint angles (`angles`); and there is recorded motion. A further source is a function of time.
"""

MOTIONS = ("gait", "footfalls", "angles")  # generators of people and four-legged animals
