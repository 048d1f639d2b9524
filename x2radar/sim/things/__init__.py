"""Things that move and must not alarm: curtain, fan, robot vacuum, washing machine and others.

`THINGS` names them. A thing is made once, with everything about it drawn from a generator,
and then gives its points at any times, without state. Frequencies, swings and speeds are
what such things do at home, by our judgement where no source is given beside a number.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from x2radar.keys import place_of
from x2radar.sim.points import Mover
from x2radar.sim.things.draws import Mount, ThingKind, draw_mount, values_of
from x2radar.sim.things.hanging import CURTAIN, DOOR, PLANT, RAIN
from x2radar.sim.things.machines import FAN, ROBOT_VACUUM, WASHING_MACHINE

__all__ = ["THINGS", "Mount", "ThingKind", "draw_mount", "draw_thing"]

THINGS: Mapping[str, ThingKind] = {
    "curtain": CURTAIN,
    "fan": FAN,
    "robot_vacuum": ROBOT_VACUUM,
    "washing_machine": WASHING_MACHINE,
    "door": DOOR,
    "plant": PLANT,
    "rain": RAIN,
}
"""Kinds of things by name, with one sentence and the numbers of each."""


def draw_thing(
    rng: np.random.Generator, kind: str, position_m: Any, raw: Any = None, where: str = "thing"
) -> Mover:
    """Return a thing of `THINGS` that moves in its place on the floor, [x, y]; or SceneError."""
    thing = THINGS[kind]
    place = np.array(place_of(position_m, f"{where}.position_m"))
    return thing.make(rng, place, values_of(rng, thing.draws, raw, where))
