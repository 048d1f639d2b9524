"""Birds in the room or at a window, and large moths close to the antenna: how they fly, and draws.

Sizes and wing beats are fits to recalled values (budgerigar 35 g, 0.30 m, 14 Hz; pigeon 330 g,
0.65 m, 7 to 8 Hz; span over mass near Rayner 1988; hawk and large owlet moths 25 to 60 Hz).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from x2radar.keys import Key
from x2radar.sim.bodies.body import Body, BodyPlan
from x2radar.sim.bodies.skins import TotalRcs
from x2radar.sim.bodies.wander import Wander, smooth_step
from x2radar.sim.points import Array, Label, Motion, Pose

_HOP_S = 0.25  # how long a small bird hops (recalled)
_GRAVITY_MPS2 = 9.81

Orbit = tuple[float, float, float]  # radius, turn rate (its sign is the way round), first angle
Flight = Callable[[Array], tuple[Array, Array, Array]]
"""Place (n_slow, 3), heading and effort of the wings, 0 to 1, at times (n_slow,)."""
Hops = Callable[[Array], tuple[Array, Array]]
"""How far a bird is off its first perch, and how far through the air, 0 to 1, likewise."""


def _flight(
    home_m: Array, orbit: Orbit, wander: Wander, effort: Wander, rest: float, *, hops: Hops | None
) -> Flight:
    """Return a course through the air: rounds about `home_m`, or a first perch there.

    `wander` offsets in x, y, z, in metres, and of the heading, in radians. The wings rest where
    `effort`, -1 to 1, is below `rest`: never at -2, but for hops at 2.
    """
    radius_m, turn_rad_s, begin_rad = orbit

    def at(t_s: Array) -> tuple[Array, Array, Array]:
        offset = wander.at(t_s)
        turn = begin_rad + turn_rad_s * t_s
        place = home_m + offset[:, :3]
        place[:, 0] += radius_m * np.cos(turn)
        place[:, 1] += radius_m * np.sin(turn)
        ahead = np.copysign(0.5 * np.pi, turn_rad_s)
        flaps = smooth_step((effort.at(t_s)[:, 0] - rest) / 0.3 + 0.5)
        if hops:
            hop, aloft = hops(t_s)
            place += hop
            flaps = np.maximum(flaps, aloft)
        return place, turn + ahead + offset[:, 3], flaps

    return at


def _hops(begin_s: Array, perch_m: Array, period_s: float) -> Hops:
    """Return hops that begin at these times of every period, from perch to perch."""

    def at(t_s: Array) -> tuple[Array, Array]:
        within = np.mod(t_s, period_s)
        # Before the first hop of a period the last one's end still holds.
        k = np.searchsorted(begin_s, within, side="right") - 1
        since = within - begin_s[k] + np.where(k < 0, period_s, 0.0)
        start, end = perch_m[k], perch_m[(k + 1) % len(begin_s)]
        share = np.clip(since / _HOP_S, 0.0, 1.0)
        offset = start + (end - start) * smooth_step(share)[:, None]
        aloft = np.where(share < 1.0, np.sin(np.pi * share) ** 2, 0.0)
        # A hop of 0.25 s under gravity rises g T^2 / 8 = 77 mm.
        offset[:, 2] += 0.077 * aloft
        return offset, aloft

    return at


@dataclass(frozen=True, slots=True)
class FlyerBuild:
    """Sizes of a flying animal's body and wings, and how it flaps."""

    body_m: float
    span_m: float
    beat_hz: float
    stroke_rad: float
    stroke_mean_rad: float
    lag_rad: float
    pitch_rad: float
    breath_hz: float = 1.0
    breath_m: float = 0.0
    folds: bool = False


def _flying(b: FlyerBuild, flight: Flight) -> Motion:
    """Return how a bird or a moth moves: body, head, tail, and two parts of each wing."""

    def pose(t_s: Array) -> Pose:
        place, heading, effort = flight(t_s)
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
        lags = (0, b.lag_rad)
        angles = [b.stroke_mean_rad + b.stroke_rad * effort * np.sin(beat - p) for p in lags]
        for first, to in ((3, left), (5, -left)):
            near, far = (_wing(a, to, up, nose, fold) for a in angles)
            wrist = body + inner * near
            axis[:, first], axis[:, first + 1] = near, far
            centre[:, first] = body + 0.5 * inner * near
            centre[:, first + 1] = wrist + 0.5 * outer * far
        return Pose(centre, axis, left[:, None])

    return pose


def _wing(angle_rad: Array, to: Array, up: Array, nose: Array, fold: Array) -> Array:
    """Return the unit vector along a wing at an angle over the horizon, folded or not."""
    out = np.cos(angle_rad)[:, None] * to + np.sin(angle_rad)[:, None] * up
    # A folded wing points backwards and a little outwards, so the mix is never zero.
    mix = out + fold * (0.2 * to - nose - out)
    return np.asarray(mix / np.sqrt((mix**2).sum(axis=1))[:, None], dtype=np.float64)


BIRD_STYLES = ("circle", "flutter", "perch")
"""In rounds through the room with glides between; in a cage or at a window; on perches."""
BIRD_MASS_KG = {"budgerigar": (0.028, 0.045), "cockatiel": (0.08, 0.12), "pigeon": (0.25, 0.4)}
MOTH_SPAN_M = (0.06, 0.13)
MOTH_BEAT_HZ = (20.0, 60.0)  # masses, spans and beats: see above
_NAMES = (
    *("body", "head", "tail"),
    *(f"{side} {part} wing" for side in ("left", "right") for part in ("inner", "outer")),
)
_LOOKS_S = np.linspace(0.0, 40.0, 97)  # over which the mean cross section is taken


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
    """Draw a bird of `BIRD_MASS_KG`; SceneError if a value is unknown or impossible."""
    Key(choices=tuple(BIRD_MASS_KG)).judge(species, "species")
    Key(choices=BIRD_STYLES).judge(style, "style")
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
    plan = _plan("pet", build, _bird_flight(rng, style, home_m))
    return plan.dressed(rng, skin, total_rcs_dbsm, _LOOKS_S)


def draw_moth(
    rng: np.random.Generator,
    *,
    home_m: tuple[float, float, float] = (0.0, 0.35, 1.2),
    total_rcs_dbsm: TotalRcs = "physical",
    skin: str = "surface",
) -> Body:
    """Draw a large moth about `home_m`; raises SceneError if a value is impossible."""
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
    )
    reach = rng.uniform(0.05, 0.15)
    radius, rate = rng.uniform(0.0, 0.12), rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 9.0)
    orbit = (radius, rate, rng.uniform(0.0, 2.0 * np.pi))
    wander = Wander(rng, [reach, reach, reach, 1.0], rng.uniform(0.25, 0.7) * np.ones(4))
    flight = _flight(np.array(home_m), orbit, wander, Wander(rng, [1.0], [1.0]), -2.0, hops=None)
    return _plan("other", build, flight).dressed(rng, skin, total_rcs_dbsm, _LOOKS_S)


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
    orbit_rad_s = rng.choice([-1.0, 1.0]) * rate
    rounds = (orbit, orbit_rad_s, rng.uniform(0.0, 2.0 * np.pi))
    wander = Wander(rng, limits, np.array([1.0, 1.0, 0.6, 0.5]) * speed)
    effort = Wander(rng, [1.0], [1.2])
    begin_s = slot * (np.arange(n_hops) + rng.uniform(0.1, 0.8, n_hops))
    perch_m = rng.uniform(-1.0, 1.0, (n_hops, 3)) * np.array([0.2, 0.2, 0.1])
    hops = _hops(begin_s, perch_m, period) if n_hops else None
    return _flight(np.array(home_m), rounds, wander, effort, rest, hops=hops)


def _plan(label: Label, b: FlyerBuild, flight: Flight) -> BodyPlan:
    # Bone and muscle at the front of the wing; feathers and scales let the wave through.
    thick = 0.02 * b.span_m
    wing = [(0.07 * b.span_m, thick, thick), (0.06 * b.span_m, 0.6 * thick, 0.6 * thick)]
    trunk = [(0.5, 0.2, 0.2), (0.17, 0.15, 0.15), (0.3, 0.06, 0.06)]
    half_m = np.vstack([b.body_m * np.array(trunk), wing, wing])
    return BodyPlan(label, _NAMES, half_m, _flying(b, flight))
