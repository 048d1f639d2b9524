"""Things that move and must not alarm: curtain, fan, robot vacuum, washing machine and others.

`THINGS` names them. A thing is made once, with everything about it drawn from a generator,
and then gives its points at any times, without state. Frequencies, swings and speeds are
what such things do at home, by our judgement where no source is given beside a number.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from x2radar.errors import SceneError
from x2radar.sim.keys import unknown
from x2radar.sim.points import Mover
from x2radar.sim.things.draws import ThingKind, floor_position, values_of
from x2radar.sim.things.hanging import PLANT
from x2radar.sim.things.machines import FAN, WASHING_MACHINE
from x2radar.sim.things.mount import MountVibration, draw_mount
from x2radar.sim.things.panels import CURTAIN, DOOR
from x2radar.sim.things.rain import RAIN
from x2radar.sim.things.vacuum import ROBOT_VACUUM

__all__ = ["THINGS", "MountVibration", "ThingKind", "draw_mount", "draw_thing"]

THINGS: Mapping[str, ThingKind] = MappingProxyType(
    {
        "curtain": CURTAIN,
        "fan": FAN,
        "robot_vacuum": ROBOT_VACUUM,
        "washing_machine": WASHING_MACHINE,
        "door": DOOR,
        "plant": PLANT,
        "rain": RAIN,
    }
)
"""Kinds of things by name, with one sentence and the numbers of each."""


def draw_thing(
    rng: np.random.Generator, kind: str, position_m: Any, raw: Any = None, where: str = "thing"
) -> Mover:
    """Return a thing that moves in its place.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws what `raw` leaves out, and everything else random.
    kind : str
        A name of `THINGS`.
    position_m : sequence of two numbers
        Where it stands on the floor, x to the right and y away from the radar, in metres: its
        middle, or the hinge of a door.
    raw : mapping, optional
        Its numbers that are given; the kind's `draws` name them.
    where : str
        Path of the thing in its scene file, for messages.

    Returns
    -------
    Mover
        Label 'other'.

    Raises
    ------
    SceneError
        If there is no such kind, or a number is unknown or impossible; one line with the
        path of the key.
    """
    if kind not in THINGS:
        raise SceneError(unknown(kind, THINGS, where, "no such thing"))
    thing = THINGS[kind]
    place = floor_position(position_m, f"{where}.position_m")
    return thing.make(rng, place, values_of(rng, thing.draws, raw, where))
