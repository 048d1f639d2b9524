"""Motions: where the parts of a body are at any time; any of them goes with any skin.

People and four-legged animals have three generators each, so that a network cannot learn one by
heart:

    gait       published strides, planned footfalls, a trunk over them (`people.walking`,
               `quadrupeds.hung`)
    footfalls  drawn strides and lags, standing feet, inverse kinematics (`people.footfalls`)
    angles     joint angles over the stride, forward kinematics (`angles`)

and there is recorded motion (`recorded`). A further source is a class with a `pose`; one that
knows joints gives the ends of a skeleton's parts to `Pose.between`.
"""

MOTIONS = ("gait", "footfalls", "angles")
"""Motion generators of people and four-legged animals, as scenes and sets call them."""
