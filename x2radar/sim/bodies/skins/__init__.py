"""Skins: how the segments of a body echo, whatever moves them.

Four laws, none of which is the truth, so that a network cannot learn one of them by heart:

    surface      ellipsoids with a trunk of one bright spot (`surface`)
    points       constant scatterers along the segments, with drawn weights (`points`)
    ellipsoids   ellipsoids by physical optics, each by itself, aspect-dependent (`surface`)
    capsules     cylinders with round ends, and shadows of what lies before them (`capsules`)

Each takes poses and gives `Points`; all fluctuation is a function of the aspect alone.
"""
