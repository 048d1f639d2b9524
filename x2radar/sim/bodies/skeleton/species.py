"""Species of four-legged animals, a row each: an animal, trained on or not, is a row here.

Cats and dogs: masses from breed standards; lengths, tails and postures recalled. Dogs wag at
2 to 6 Hz with 1 to 3 m/s at the tip. Strides of dogs follow Alexander and Jayes (1983; see
`gait`). Rabbits: 1 to 3 kg, head and body 34 to 50 cm, tail 4 to 7 cm (Gibb, in Rabbits, Hares
and Pikas, IUCN 1990); half-bounds at every speed (Camp and Borwick, Rabbit locomotion, 1927);
4 strides a second at 1.8 m/s, as animals of 2 kg have where they begin to gallop (Heglund and
Taylor 1988); 30 to 60 breaths a minute at rest (Harcourt-Brown, Textbook of Rabbit Medicine,
2002). Numbers and sources are recalled.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from x2radar.sim.points import Label

Span = tuple[float, float]  # least and greatest of an even draw
Band = tuple[float, float]  # least of an even draw, and how far the greatest is above it
Draw = Callable[[np.random.Generator], float]


@dataclass(frozen=True, slots=True)
class Tail:
    """How a tail moves: always and slowly, or it wags in bouts, as far as its tip is fast."""

    hz: Band
    lag_rad: Band  # of each third
    rad: Band = (0.0, 0.0)
    tip_mps: Span | None = None  # of one that wags in bouts


@dataclass(frozen=True, slots=True, kw_only=True)
class Species:
    """How animals of one kind are built, how they go, and what they do."""

    name: str  # as scenes call it
    mass_kg: Draw
    possible_kg: Span  # masses that a scene may ask for
    tall: Draw  # draws the hip's height over ``0.155 M^0.35`` m
    back: Span  # lengths, in hip heights; the back is from hip to shoulder
    neck: Span
    head: Span
    tail: Span
    paw: Span = (0.13, 0.18)
    leg: float  # length of a straight leg, in hip heights
    # Of the mass, at the density of water: with the lengths it makes the cross sections.
    trunk_share: float = 0.55
    # Factor and exponent of ``k h Fr^e`` at any gait, or at symmetric and asymmetric ones.
    stride: tuple[tuple[float, float], ...]
    # Rows of `gait.FOOTWORK`, each with the Froude number up to which it is the usual one.
    gaits: Mapping[str, float]
    styles: tuple[str, ...]  # keys of `pet.PET_STYLES`: what it does
    jump: Span  # height of what it jumps onto, in hip heights
    neck_rad: Band  # how far the neck points up
    rise_rad: Band  # and the tail
    tail_moves: Tail
    breaths_per_min: Span  # at rest
    label: Label = "pet"  # what an alarm should take it for
    # How often training's animals do what, going or in their place: what a home sees most the more
    # often; empty for one that is not trained on.
    taught: Mapping[str, float] = field(default_factory=dict)


def _normal(mean: float, sigma: float, low: float, high: float) -> Draw:
    return lambda rng: float(np.clip(rng.normal(mean, sigma), low, high))


def _dog_kg(rng: np.random.Generator) -> float:
    spans = ((3.0, 10.0), (10.0, 25.0), (25.0, 60.0))
    low, high = spans[int(rng.choice(len(spans), p=(0.4, 0.35, 0.25)))]
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


_ROWS = (
    Species(
        name="cat",
        mass_kg=_normal(4.4, 1.1, 2.5, 7.0),
        possible_kg=(1.0, 10.0),
        tall=_normal(0.93, 0.04, 0.7, 1.25),
        back=(1.1, 1.3),
        neck=(0.22, 0.30),
        head=(0.36, 0.44),
        tail=(0.95, 1.25),
        leg=1.30,
        # Cats, which go on bent legs, take longer strides for their hip height.
        stride=((3.5, 0.42),),
        gaits={"walk": 0.5, "trot": 2.0, "bound": math.inf},
        styles=(
            *("roam", "walk", "trot", "bound", "sniff", "stalk"),
            *("stand", "sit", "lie", "groom", "scratch", "play", "jump"),
        ),
        jump=(1.6, 3.2),  # a chair or a table
        neck_rad=(0.15, 0.35),
        rise_rad=(-0.5, 1.4),
        tail_moves=Tail(hz=(0.3, 0.6), rad=(0.25, 0.5), lag_rad=(0.6, 0.6)),
        breaths_per_min=(20.0, 30.0),
        taught={"roam": 1.0, "walk": 2.0, "trot": 1.5, "sniff": 0.7, "stalk": 1.0}
        | {"sit": 0.5, "stand": 0.3, "lie": 0.3, "groom": 0.8}
        | {"scratch": 0.3, "play": 0.5, "jump": 1.0},
    ),
    Species(
        name="dog",
        mass_kg=_dog_kg,
        possible_kg=(1.0, 100.0),
        tall=lambda rng: float(np.clip(np.exp(rng.normal(0.0, 0.09)), 0.7, 1.25)),
        back=(0.95, 1.2),
        neck=(0.32, 0.48),
        head=(0.42, 0.56),
        tail=(0.45, 0.85),
        leg=1.18,
        stride=((2.4, 0.34), (1.9, 0.40)),
        gaits={"walk": 0.5, "trot": 2.5, "pace": 0.0, "canter": math.inf},
        styles=(
            *("roam", "walk", "trot", "pace", "canter", "sniff"),
            *("stand", "sit", "lie", "pant", "groom", "scratch", "play", "jump"),
        ),
        jump=(0.8, 1.3),  # a sofa
        neck_rad=(0.35, 0.6),
        rise_rad=(0.0, 1.0),
        tail_moves=Tail(hz=(2.0, 4.0), tip_mps=(1.0, 3.0), lag_rad=(0.15, 0.25)),
        breaths_per_min=(15.0, 30.0),
        taught={"roam": 1.0, "walk": 2.0, "trot": 2.0, "pace": 1.0, "canter": 1.0, "sniff": 1.5}
        | {"sit": 0.5, "stand": 0.4, "lie": 0.3, "pant": 0.3}
        | {"groom": 0.4, "scratch": 0.4, "play": 0.6, "jump": 0.5},
    ),
    Species(
        name="rabbit",
        mass_kg=_normal(1.9, 0.45, 1.0, 3.0),
        possible_kg=(0.8, 6.0),
        tall=_normal(0.72, 0.05, 0.6, 0.85),
        back=(1.25, 1.5),  # shorter than stretched: it stands arched
        neck=(0.20, 0.28),
        head=(0.55, 0.68),
        tail=(0.30, 0.45),
        paw=(0.25, 0.35),  # between a fore paw and the long hind foot
        leg=1.40,
        stride=((2.2, 0.40),),
        gaits={"bound": math.inf},
        styles=("roam", "bound", "sniff", "sit", "lie", "groom", "scratch", "play", "jump"),
        jump=(1.2, 2.4),
        neck_rad=(0.30, 0.50),
        rise_rad=(0.6, 0.6),
        tail_moves=Tail(hz=(0.3, 0.6), rad=(0.0, 0.1), lag_rad=(0.1, 0.1)),
        breaths_per_min=(30.0, 60.0),
    ),
)
SPECIES: Mapping[str, Species] = {row.name: row for row in _ROWS}  # every species, by name
