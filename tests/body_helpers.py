"""Bodies of every kind, drawn once, and what tests measure on them."""

from functools import cache

import numpy as np

from x2radar.sim.bodies.flyer import BIRD_MASS_KG, BIRD_STYLES, draw_bird, draw_moth
from x2radar.sim.bodies.motion.people.gait import STYLES
from x2radar.sim.bodies.path.path import Agility, Path
from x2radar.sim.bodies.person import draw_person
from x2radar.sim.bodies.pet import draw_pet
from x2radar.sim.bodies.skeleton.species import SPECIES

ANTENNA_M = np.array([0.0, 0.0, 1.2])
PEOPLE = [("human", style) for style in STYLES]
PETS = [(name, style) for name, species in SPECIES.items() for style in species.styles]
BIRDS = [(name, style) for name in BIRD_MASS_KG for style in BIRD_STYLES]
WAYS = [*PEOPLE, *PETS, *BIRDS, ("moth", "")]
"""Every kind of body with everything that it does."""
_BRISK = Agility(acceleration_mps2=20.0)


def draw(kind, style="", seed=0, **options):
    """Return a body with new draws."""
    rng = np.random.default_rng(seed)
    if kind == "human":
        return draw_person(rng, style=style or "walk", **options)
    if kind in SPECIES:
        return draw_pet(rng, species=kind, style=style or None, **options)
    if kind == "moth":
        return draw_moth(rng, **options)
    return draw_bird(rng, species=kind, style=style or "circle", **options)


drawn = cache(draw)
"""The same, drawn once: bodies have no state."""


@cache
def past(speed_mps):
    """A straight path on which a pet is up to speed from 1 to 6 s."""
    return Path.through(((0.0, 3.0), (7 * speed_mps, 3.0)), speed_mps, agility=_BRISK)


def parts(body, t_s):
    """Return where the middles of the parts are, by name, breath and skin apart."""
    centre_m = body.motion(t_s).centre_m
    return {name: centre_m[:, k] for k, name in enumerate(body.names)}


def speeds(place_m, step_s):
    """Return speeds between neighbours in time, shape (n_slow - 1, ...)."""
    return np.linalg.norm(np.diff(place_m, axis=0), axis=-1) / step_s


def strongest_hz(signal, step_s, above_hz=0.0, below_hz=np.inf):
    """Return the frequency of the strongest line of a real signal."""
    n = 2 ** int(np.ceil(np.log2(8 * len(signal))))
    spectrum = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal)), n))
    hz = np.fft.rfftfreq(n, step_s)
    return hz[np.where((hz > above_hz) & (hz < below_hz), spectrum, 0.0).argmax()]
