"""Birds in the room or at a window, and large moths close to the antenna.

A moth is a thousandth of a dog in cross section, but the echo falls with the fourth power of
the range: at 0.3 m it is as loud as a dog at 2 m.

Sizes and wing beats are fits to recalled values (budgerigar 35 g, 0.30 m, 14 Hz; pigeon
330 g, 0.65 m, 7 to 8 Hz; span over mass near Rayner 1988, recalled; hawk moths and large
owlet moths 25 to 60 Hz, silk moths slower).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.sim.bodies.flyer.flight import Flight, Wander
from x2radar.sim.bodies.skin.base import Skin, TotalRcs, sized
from x2radar.sim.bodies.skin.draw import draw_skin
from x2radar.sim.points import Label, Points

Array = NDArray[np.float64]

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
    "body",
    "head",
    "tail",
    "left inner wing",
    "left outer wing",
    "right inner wing",
    "right outer wing",
)
_GRAVITY_MPS2 = 9.81


@dataclass(frozen=True, slots=True)
class FlyerBuild:
    """What a flying animal is like."""

    body_m: float
    span_m: float
    beat_hz: float
    stroke_rad: float
    stroke_mean_rad: float
    lag_rad: float
    pitch_rad: float
    breath_hz: float
    breath_m: float
    folds: bool


@dataclass(frozen=True, slots=True, eq=False)
class Flyer:
    """A bird or a moth; see `Mover`."""

    label: Label
    names: tuple[str, ...]
    build: FlyerBuild
    flight: Flight
    skin: Skin

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points; see `Mover`."""
        centre, axis, side = self.posture(t_s)
        return self.skin.points(centre, axis, side, antenna_m)

    def posture(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return middles, axes and side vectors of its parts; see `quadruped.posture`."""
        return _posture(self.build, self.flight, t_s)


def _posture(b: FlyerBuild, flight: Flight, t_s: Array) -> tuple[Array, Array, Array]:
    place, heading, effort = flight.at(t_s)
    cos, sin, zero = np.cos(heading), np.sin(heading), np.zeros_like(heading)
    nose = np.stack([cos, sin, zero], axis=-1) * np.cos(b.pitch_rad)
    nose[:, 2] = np.sin(b.pitch_rad)
    left = np.stack([-sin, cos, zero], axis=-1)
    up = np.cross(nose, left)

    beat = 2.0 * np.pi * b.beat_hz * t_s
    # The body hangs from wings that lift it in half of each beat only: it goes through
    # g / omega^2, opposite to the wings.
    body = place.copy()
    body[:, 2] -= effort * _GRAVITY_MPS2 / (2.0 * np.pi * b.beat_hz) ** 2 * np.sin(beat)
    body[:, 2] += b.breath_m * (1.0 - effort) * np.sin(2.0 * np.pi * b.breath_hz * t_s)

    inner, outer = 0.22 * b.span_m, 0.28 * b.span_m
    centre, axis = np.empty((len(t_s), 7, 3)), np.empty((len(t_s), 7, 3))
    axis[:, :3] = nose[:, None]
    for k, along in enumerate((0.0, 0.6, -0.75)):
        centre[:, k] = body + along * b.body_m * nose
    fold = (1.0 - effort)[:, None] * (1.0 if b.folds else 0.0)
    angles = [b.stroke_mean_rad + b.stroke_rad * effort * np.sin(beat - p) for p in (0, b.lag_rad)]
    for first, to in ((3, left), (5, -left)):
        near, far = (_wing(a, to, up, nose, fold) for a in angles)
        wrist = body + inner * near
        axis[:, first], axis[:, first + 1] = near, far
        centre[:, first] = body + 0.5 * inner * near
        centre[:, first + 1] = wrist + 0.5 * outer * far
    return centre, axis, left[:, None]


def _wing(angle_rad: Array, to: Array, up: Array, nose: Array, fold: Array) -> Array:
    """Return the unit vector along a wing at an angle over the horizon, folded or not."""
    out = np.cos(angle_rad)[:, None] * to + np.sin(angle_rad)[:, None] * up
    # A folded wing points backwards and a little outwards, so the mix is never zero.
    mix = out + fold * (0.2 * to - nose - out)
    return np.asarray(mix / np.sqrt((mix**2).sum(axis=1))[:, None], dtype=np.float64)


def draw_bird(
    rng: np.random.Generator,
    *,
    species: str = "budgerigar",
    style: str = "circle",
    home_m: tuple[float, float, float] = (0.0, 2.0, 1.6),
    mass_kg: float | None = None,
    total_rcs_dbsm: TotalRcs = None,
    skin: str = "surface",
) -> Flyer:
    """Draw a bird.

    Parameters
    ----------
    rng : numpy.random.Generator
        Everything random comes from it.
    species : {'budgerigar', 'cockatiel', 'pigeon'}, optional
        Sets the distribution of masses.
    style : str, optional
        A key of `BIRD_STYLES`.
    home_m : tuple of float, optional
        Middle of its rounds, or first perch, in room coordinates.
    mass_kg : float, optional
        Instead of a draw, 0.01 to 2.
    total_rcs_dbsm : float, 'physical' or None, optional
        See `skin.base.sized`; drawn by default.

    Raises
    ------
    SceneError
        If a value is unknown or impossible; the message names its key.
    """
    if species not in BIRD_MASS_KG:
        msg = f"species: no bird '{species}'; known are {', '.join(BIRD_MASS_KG)}"
        raise SceneError(msg)
    if style not in BIRD_STYLES:
        msg = f"style: no bird style '{style}'; known are {', '.join(BIRD_STYLES)}"
        raise SceneError(msg)
    drawn_kg = float(rng.uniform(*BIRD_MASS_KG[species]))
    kg = drawn_kg if mass_kg is None else mass_kg
    if not 0.01 <= kg <= 2.0:
        msg = f"mass_kg: {kg} is not in 0.01 to 2 for a bird"
        raise SceneError(msg)
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
) -> Flyer:
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
        wander=Wander.draw(
            rng, np.array([reach, reach, reach, 1.0]), rng.uniform(0.25, 0.7) * np.ones(4)
        ),
        effort=Wander.draw(rng, np.ones(1), np.ones(1)),
        rest_below=-2.0,
        hop_s=np.zeros(0),
        perch_m=np.zeros((0, 3)),
        period_s=60.0,
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
    limits = np.array([reach, reach, 0.6 * reach, 0.3 if style == "circle" else 1.2])
    return Flight(
        home_m=_place(home_m),
        orbit_m=orbit,
        orbit_rad_s=rng.choice([-1.0, 1.0]) * rate,
        orbit_rad=rng.uniform(0.0, 2.0 * np.pi),
        wander=Wander.draw(rng, limits, np.array([1.0, 1.0, 0.6, 0.5]) * speed),
        effort=Wander.draw(rng, np.ones(1), np.full(1, 1.2)),
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
) -> Flyer:
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
    drawn = draw_skin(rng, skin, half)
    drawn = sized(drawn, rng, total, _posture(b, flight, np.linspace(0.0, 40.0, 97)))
    return Flyer(label, drawn.names(_NAMES), b, flight, drawn)


def _place(home_m: tuple[float, float, float]) -> Array:
    if not all(-1000.0 <= x <= 1000.0 for x in home_m):
        msg = f"home_m: {home_m} is not within 1000 m"
        raise SceneError(msg)
    return np.array(home_m, dtype=np.float64)
