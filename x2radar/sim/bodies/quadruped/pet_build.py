"""Random sizes and manners of animals.

The hip is ``0.155 M^0.35`` m high, times what animals differ by. Resting breaths follow
``53.5 M^-0.26`` a minute (Stahl 1967, recalled), within what the species has; panting is at 4
to 6 Hz (recalled).
"""

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.quadruped.build import Manner, QuadrupedBuild
from x2radar.sim.bodies.quadruped.species import Band, Species, Swing

Array = NDArray[np.float64]

_WIDEST_WAG_RAD = 1.1
"""A tail does not reach beside the body (recalled)."""


def draw_build(
    rng: np.random.Generator, species: Species, mass_kg: float | None = None
) -> QuadrupedBuild:
    """Draw the sizes of an animal; raises SceneError if `mass_kg` is impossible for it."""
    drawn = species.mass_kg(rng)
    kg = drawn if mass_kg is None else mass_kg
    least, most = species.possible_kg
    if not least <= kg <= most:
        msg = f"mass_kg: {kg} is not in {least:g} to {most:g} for a {species.name}"
        raise SceneError(msg)
    hip = 0.155 * kg**0.35 * species.tall(rng)
    back = hip * rng.uniform(*species.back)
    depth_over_width = rng.uniform(1.1, 1.3)
    # Volume of an ellipsoid; its first half-length is the trunk's of `half_lengths`.
    section = species.trunk_share * kg / 1000.0 / (4.0 / 3.0 * np.pi * 0.58 * back)
    half_width = float(np.sqrt(section / depth_over_width))
    leg = hip * species.leg
    upper = leg * rng.uniform(0.46, 0.50)
    return QuadrupedBuild(
        mass_kg=kg,
        hip_m=hip,
        back_m=back,
        half_width_m=half_width,
        half_depth_m=depth_over_width * half_width,
        neck_m=hip * rng.uniform(*species.neck),
        head_m=hip * rng.uniform(*species.head),
        tail_m=hip * rng.uniform(*species.tail),
        upper_m=upper,
        lower_m=leg - upper,
        paw_m=hip * rng.uniform(*species.paw),
        half_track_m=half_width * rng.uniform(0.6, 0.9),
    )


def draw_manner(
    rng: np.random.Generator, build: QuadrupedBuild, species: Species, style: str, nod_rad: float
) -> Manner:
    """Draw what an animal does with head, tail and chest, in a style of `PET_STYLES`.

    How much is drawn does not depend on species and style. `nod_rad` is that of its gait.
    """
    u = rng.uniform(0.0, 1.0, 8)
    sits = style in {"sit", "groom", "scratch"}
    stays = sits or style in {"stand", "lie", "pant", "play"}
    neck = _in(species.neck_rad, u[0])
    if style in {"stalk", "lie", "pant"}:
        neck = 0.4 * u[0] + (0.2 if style == "pant" else -0.1)
    # On the floor the tail of one that sits or lies is level.
    rise = 0.0 if sits or style in {"lie", "pant"} else _in(species.rise_rad, u[1])
    wag_hz, wag_rad, lag = _wag(rng, build, float(rise), species)
    yaw, pitch = (0.7, 0.2) if stays else (0.25, 0.05)
    often = {"sniff": 0.45, "lie": -0.3, "groom": 0.4}.get(style, -2.0)
    nose = {"lie": (-0.25, 0.0), "groom": (-0.9, -1.2)}.get(style, (-1.25, -1.0))
    lazy = {"sit": -0.3, "stand": -0.3, "lie": 0.5, "pant": 0.3}.get(style, 0.1)
    return Manner(
        neck_rad=float(neck),
        head_rad=float(-0.35 + 0.35 * u[2]),
        down_rad=nose,
        nod_rad=nod_rad * float(0.6 + 0.8 * u[3]),
        gaze=Wander.draw(rng, np.array([yaw, pitch]), 0.6 * np.array([yaw, pitch])),
        down=Wander.draw(rng, np.ones(1), np.full(1, 0.35)),
        down_below=often,
        tail_rad=float(rise),
        wag_hz=wag_hz,
        wag_rad=wag_rad,
        wag_lag_rad=lag,
        bout=Wander.draw(rng, np.ones(1), np.full(1, 0.4)),
        wag_above=-2.0
        if isinstance(species.tail_moves, Swing)
        else lazy + 0.6 * float(u[4] - 0.5),
        breath_hz=_breaths_hz(
            build.mass_kg, u[5], style, species, goes=not stays or style == "play"
        ),
        breath_m=float(
            (0.0005 if style == "pant" else 0.0011) * build.mass_kg**0.33 * (0.7 + 0.6 * u[6])
        ),
        breath_rad=float(2.0 * np.pi * u[7]),
        lick_hz=float(1.5 + 2.0 * u[3]),
        lick_rad=float(0.10 + 0.20 * u[2]) if style == "groom" else 0.0,
    )


def _wag(
    rng: np.random.Generator, build: QuadrupedBuild, rise_rad: float, species: Species
) -> tuple[float, float, float]:
    """Return frequency, amplitude and lag of a tail's wag."""
    u, v, w = rng.uniform(0.0, 1.0, 3)
    moves = species.tail_moves
    if isinstance(moves, Swing):
        return _in(moves.hz, u), _in(moves.rad, v), _in(moves.lag_rad, w)
    (slowest_hz, fastest_hz), (least_mps, most_mps) = moves.hz, moves.tip_mps
    lag = 0.15 + 0.25 * w
    thirds = np.cos(rise_rad * np.array([1.0, 0.8, 0.6])) * np.exp(-1j * lag * np.arange(3))
    arm = 2.0 * np.pi * build.tail_m * float(np.abs(thirds.mean()))
    tip = min(least_mps + (most_mps - least_mps) * u, fastest_hz * arm * _WIDEST_WAG_RAD)
    slowest = max(slowest_hz, tip / (arm * _WIDEST_WAG_RAD))
    hz = slowest + (fastest_hz - slowest) * v
    return float(hz), float(tip / (arm * hz)), float(lag)


def _breaths_hz(
    mass_kg: float, share: float, style: str, species: Species, *, goes: bool
) -> float:
    if style == "pant":
        return 4.0 + 2.0 * share
    per_minute = 53.5 * mass_kg**-0.26 * (0.75 + 0.4 * share)
    per_minute = float(np.clip(per_minute, *species.breaths_per_min))
    # Going about takes more air than resting does.
    return per_minute / 60.0 * (1.8 if goes else 1.0)


def _in(band: Band, share: float) -> float:
    """Return the number at a share of a band, 0 to 1."""
    least, width = band
    return float(least + width * share)
