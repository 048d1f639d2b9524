"""Birds in the room or at a window, and large moths close to the antenna.

A moth is a thousandth of a dog in cross section, but the echo falls with the fourth power of
the range: at 0.3 m it is as loud as a dog at 2 m.

Sizes and wing beats are fits to recalled values (budgerigar 35 g, 0.30 m, 14 Hz; pigeon
330 g, 0.65 m, 7 to 8 Hz; span over mass near Rayner 1988, recalled; hawk moths and large
owlet moths 25 to 60 Hz, silk moths slower).
"""

import numpy as np

from x2radar.keys import Key
from x2radar.sim.bodies.body import Body, BodyPlan
from x2radar.sim.bodies.motion.flight import Flight, FlyerBuild, Flying
from x2radar.sim.bodies.skins.draw import TotalRcs
from x2radar.sim.bodies.wander import Wander
from x2radar.sim.points import Array, Label

BIRD_STYLES = {
    "circle": "flies rounds through the room, glides in between",
    "flutter": "flutters in one place, in a cage or at a window",
    "perch": "sits, breathes and hops between perches",
}
BIRD_MASS_KG = {"budgerigar": (0.028, 0.045), "cockatiel": (0.08, 0.12), "pigeon": (0.25, 0.4)}
MOTH_SPAN_M = (0.06, 0.13)
MOTH_BEAT_HZ = (20.0, 60.0)
"""Masses, spans and beats: see above."""
_NAMES = (
    *("body", "head", "tail"),
    *(f"{side} {part} wing" for side in ("left", "right") for part in ("inner", "outer")),
)
_LOOKS_S = np.linspace(0.0, 40.0, 97)
"""Over which the mean cross section is taken."""


def draw_bird(
    rng: np.random.Generator,
    *,
    species: str = "budgerigar",
    style: str = "circle",
    home_m: tuple[float, float, float] = (0.0, 2.0, 1.6),
    mass_kg: float | None = None,
    total_rcs_dbsm: TotalRcs = None,
    skin: str = "surface",
) -> Body:
    """Draw a bird; raises SceneError if a value is unknown or impossible.

    `species` is a key of `BIRD_MASS_KG`, `style` one of `BIRD_STYLES`; `home_m` is the middle of
    its rounds, or its first perch, in room coordinates; `mass_kg` 0.01 to 2, instead of a draw.
    `total_rcs_dbsm` and `skin` are as in `draw_person`.
    """
    Key(choices=tuple(BIRD_MASS_KG)).judge(species, "species")
    Key(choices=tuple(BIRD_STYLES)).judge(style, "style")
    drawn_kg = float(rng.uniform(*BIRD_MASS_KG[species]))
    kg = drawn_kg if mass_kg is None else mass_kg
    Key(0.01, 2.0).judge(kg, "mass_kg")
    build = FlyerBuild(
        body_m=0.29 * kg**0.36 * rng.uniform(0.9, 1.1),
        span_m=1.1 * kg**0.39 * rng.uniform(0.92, 1.08),
        beat_hz=5.4 * kg**-0.3 * rng.uniform(0.9, 1.1),
        stroke_rad=np.deg2rad(rng.uniform(40.0, 60.0)),
        stroke_mean_rad=np.deg2rad(rng.uniform(0.0, 15.0)),
        lag_rad=rng.uniform(0.3, 0.9),
        pitch_rad=np.deg2rad(rng.uniform(5.0, 50.0) if style != "circle" else 8.0),
        breath_hz=0.55 * kg**-0.31 * rng.uniform(0.8, 1.2),
        breath_m=0.004 * kg**0.36 * rng.uniform(0.7, 1.3),
        folds=style == "perch",
    )
    flight = _bird_flight(rng, style, home_m)
    return _flyer(rng, "pet", build, flight, (total_rcs_dbsm, skin))


def draw_moth(
    rng: np.random.Generator,
    *,
    home_m: tuple[float, float, float] = (0.0, 0.35, 1.2),
    total_rcs_dbsm: TotalRcs = "physical",
    skin: str = "surface",
) -> Body:
    """Draw a large moth; raises SceneError if a value is impossible.

    `home_m` is what it flies about, such as the module's lamp, in room coordinates. Its total
    cross section is physical by default: close to the antenna its echo is loud without help.
    """
    span = rng.uniform(*MOTH_SPAN_M)
    # Within the range large moths beat slower.
    share = np.clip((span - MOTH_SPAN_M[0]) / (MOTH_SPAN_M[1] - MOTH_SPAN_M[0]), 0, 1)
    low, high = np.log(MOTH_BEAT_HZ)
    build = FlyerBuild(
        body_m=0.38 * span * rng.uniform(0.85, 1.15),
        span_m=span,
        beat_hz=np.exp(high - (high - low) * (0.7 * share + 0.3 * rng.uniform())),
        stroke_rad=np.deg2rad(rng.uniform(45.0, 65.0)),
        stroke_mean_rad=np.deg2rad(rng.uniform(0.0, 15.0)),
        lag_rad=rng.uniform(0.1, 0.5),
        pitch_rad=np.deg2rad(rng.uniform(10.0, 45.0)),
        breath_hz=1.0,
        breath_m=0.0,
        folds=False,
    )
    reach = rng.uniform(0.05, 0.15)
    flight = Flight(
        home_m=_place(home_m),
        orbit_m=rng.uniform(0.0, 0.12),
        orbit_rad_s=rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 9.0),
        orbit_rad=rng.uniform(0.0, 2.0 * np.pi),
        wander=Wander.draw(rng, [reach, reach, reach, 1.0], rng.uniform(0.25, 0.7) * np.ones(4)),
        effort=Wander.draw(rng, [1.0], [1.0]),
        rest_below=-2.0,
    )
    return _flyer(rng, "other", build, flight, (total_rcs_dbsm, skin))


def _bird_flight(
    rng: np.random.Generator, style: str, home_m: tuple[float, float, float]
) -> Flight:
    orbit, reach, speed, rest = {
        "circle": (rng.uniform(0.6, 1.2), 0.3, 0.6, -0.25),
        "flutter": (0.0, rng.uniform(0.08, 0.25), rng.uniform(0.3, 0.8), -1.0),
        "perch": (0.0, 0.01, 0.01, 2.0),
    }[style]
    rate = rng.uniform(1.5, 3.0) / orbit if style == "circle" else 0.0
    period = rng.uniform(30.0, 60.0)
    n_hops = int(rng.integers(6, 15)) if style == "perch" else 0
    slot = period / max(n_hops, 1)
    limits = (reach, reach, 0.6 * reach, 0.3 if style == "circle" else 1.2)
    return Flight(
        home_m=_place(home_m),
        orbit_m=orbit,
        orbit_rad_s=rng.choice([-1.0, 1.0]) * rate,
        orbit_rad=rng.uniform(0.0, 2.0 * np.pi),
        wander=Wander.draw(rng, limits, np.array([1.0, 1.0, 0.6, 0.5]) * speed),
        effort=Wander.draw(rng, [1.0], [1.2]),
        rest_below=rest,
        hop_s=slot * (np.arange(n_hops) + rng.uniform(0.1, 0.8, n_hops)),
        perch_m=rng.uniform(-1.0, 1.0, (n_hops, 3)) * np.array([0.2, 0.2, 0.1]),
        period_s=period,
    )


def _flyer(
    rng: np.random.Generator,
    label: Label,
    b: FlyerBuild,
    flight: Flight,
    echo: tuple[TotalRcs, str],
) -> Body:
    total, skin = echo
    # Bone and muscle at the front of the wing; feathers and scales let the wave through.
    thick = 0.02 * b.span_m
    wing = [(0.07 * b.span_m, thick, thick), (0.06 * b.span_m, 0.6 * thick, 0.6 * thick)]
    half = [
        (0.5 * b.body_m, 0.2 * b.body_m, 0.2 * b.body_m),
        (0.17 * b.body_m, 0.15 * b.body_m, 0.15 * b.body_m),
        (0.3 * b.body_m, 0.06 * b.body_m, 0.06 * b.body_m),
        *wing,
        *wing,
    ]
    plan = BodyPlan(label, _NAMES, np.array(half), Flying(b, flight))
    return plan.dressed(rng, skin, total, _LOOKS_S)


def _place(home_m: tuple[float, float, float]) -> Array:
    for value in home_m:
        Key(-1000.0, 1000.0).judge(value, "home_m")
    return np.array(home_m, dtype=np.float64)
