"""Random sizes and manners of cats and dogs.

Masses: cats 2.5 to 7 kg, dogs 3 to 60 kg in three classes (recalled from breed standards).
The hip is ``0.155 M^0.35`` m high, times what breeds differ by. Trunks hold 55 % of the mass
at the density of water. Resting breaths follow ``53.5 M^-0.26`` a minute (Stahl 1967,
recalled), within 15 to 30 for dogs and 20 to 30 for cats. Dogs wag at 2 to 6 Hz with 1 to
3 m/s at the tip, and pant at 4 to 6 Hz (recalled).
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.quadruped.build import Manner, QuadrupedBuild

Array = NDArray[np.float64]
Species = Literal["cat", "dog"]

CAT_KG = (2.5, 7.0)
DOG_KG = ((3.0, 10.0), (10.0, 25.0), (25.0, 60.0))
DOG_SHARE = (0.4, 0.35, 0.25)
POSSIBLE_KG = {"cat": (1.0, 10.0), "dog": (1.0, 100.0)}
WAG_HZ = (2.0, 6.0)
WAG_MPS = (1.0, 3.0)
_WIDEST_WAG_RAD = 1.1


def draw_build(
    rng: np.random.Generator, species: Species, mass_kg: float | None = None
) -> QuadrupedBuild:
    """Draw the sizes of an animal.

    Parameters
    ----------
    rng : numpy.random.Generator
        Everything random comes from it.
    species : {'cat', 'dog'}
        What it is.
    mass_kg : float, optional
        Instead of a draw, within `POSSIBLE_KG`.

    Returns
    -------
    QuadrupedBuild
        Its sizes.

    Raises
    ------
    SceneError
        If the mass is impossible.
    """
    is_cat = species == "cat"
    if is_cat:
        drawn = float(np.clip(rng.normal(4.4, 1.1), *CAT_KG))
    else:
        low, high = DOG_KG[int(rng.choice(len(DOG_KG), p=DOG_SHARE))]
        drawn = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    kg = drawn if mass_kg is None else mass_kg
    least, most = POSSIBLE_KG[species]
    if not least <= kg <= most:
        msg = f"mass_kg: {kg} is not in {least:g} to {most:g} for a {species}"
        raise SceneError(msg)
    tall = rng.normal(0.93, 0.04) if is_cat else np.exp(rng.normal(0.0, 0.09))
    hip = 0.155 * kg**0.35 * float(np.clip(tall, 0.7, 1.25))
    back = hip * (rng.uniform(1.1, 1.3) if is_cat else rng.uniform(0.95, 1.2))
    depth_over_width = rng.uniform(1.1, 1.3)
    # Volume of an ellipsoid; its first half-length is the trunk's of `half_lengths`.
    section = 0.55 * kg / 1000.0 / (4.0 / 3.0 * np.pi * 0.58 * back)
    half_width = float(np.sqrt(section / depth_over_width))
    leg = hip * (1.30 if is_cat else 1.18)
    upper = leg * rng.uniform(0.46, 0.50)
    return QuadrupedBuild(
        mass_kg=kg,
        hip_m=hip,
        back_m=back,
        half_width_m=half_width,
        half_depth_m=depth_over_width * half_width,
        neck_m=hip * (rng.uniform(0.22, 0.30) if is_cat else rng.uniform(0.32, 0.48)),
        head_m=hip * (rng.uniform(0.36, 0.44) if is_cat else rng.uniform(0.42, 0.56)),
        tail_m=hip * (rng.uniform(0.95, 1.25) if is_cat else rng.uniform(0.45, 0.85)),
        upper_m=upper,
        lower_m=leg - upper,
        paw_m=hip * rng.uniform(0.13, 0.18),
        half_track_m=half_width * rng.uniform(0.6, 0.9),
    )


def draw_manner(
    rng: np.random.Generator, build: QuadrupedBuild, species: Species, style: str, nod_rad: float
) -> Manner:
    """Draw what an animal does with head, tail and chest.

    Parameters
    ----------
    rng : numpy.random.Generator
        Everything random comes from it; how much does not depend on species and style.
    build : QuadrupedBuild
        Its sizes.
    species : {'cat', 'dog'}
        What it is.
    style : str
        A key of `PET_STYLES`.
    nod_rad : float
        How far the neck nods in its gait.

    Returns
    -------
    Manner
        Its manners.
    """
    is_cat, u = species == "cat", rng.uniform(0.0, 1.0, 8)
    sits = style in {"sit", "groom", "scratch"}
    stays = sits or style in {"stand", "lie", "pant", "play"}
    neck = 0.15 + 0.35 * u[0] if is_cat else 0.35 + 0.6 * u[0]
    if style in {"stalk", "lie", "pant"}:
        neck = 0.4 * u[0] + (0.2 if style == "pant" else -0.1)
    # On the floor the tail of one that sits or lies is level.
    rise = 0.0 if sits or style in {"lie", "pant"} else (1.4 * u[1] - 0.5 if is_cat else u[1])
    wag_hz, wag_rad, lag = _wag(rng, build, float(rise), is_cat=is_cat)
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
        wag_above=-2.0 if is_cat else lazy + 0.6 * float(u[4] - 0.5),
        breath_hz=_breaths_hz(
            build.mass_kg, u[5], style, is_cat=is_cat, goes=not stays or style == "play"
        ),
        breath_m=float(
            (0.0005 if style == "pant" else 0.0011) * build.mass_kg**0.33 * (0.7 + 0.6 * u[6])
        ),
        breath_rad=float(2.0 * np.pi * u[7]),
        lick_hz=float(1.5 + 2.0 * u[3]),
        lick_rad=float(0.10 + 0.20 * u[2]) if style == "groom" else 0.0,
    )


def _wag(
    rng: np.random.Generator, build: QuadrupedBuild, rise_rad: float, *, is_cat: bool
) -> tuple[float, float, float]:
    """Return frequency, amplitude and lag of a tail's wag."""
    u, v, w = rng.uniform(0.0, 1.0, 3)
    if is_cat:
        # A cat's tail moves slowly from side to side, its tip well behind its base.
        return float(0.3 + 0.6 * u), float(0.25 + 0.5 * v), float(0.6 + 0.6 * w)
    lag = 0.15 + 0.25 * w
    thirds = np.cos(rise_rad * np.array([1.0, 0.8, 0.6])) * np.exp(-1j * lag * np.arange(3))
    arm = 2.0 * np.pi * build.tail_m * float(np.abs(thirds.mean()))
    tip = min(WAG_MPS[0] + (WAG_MPS[1] - WAG_MPS[0]) * u, WAG_HZ[1] * arm * _WIDEST_WAG_RAD)
    slowest = max(WAG_HZ[0], tip / (arm * _WIDEST_WAG_RAD))
    hz = slowest + (WAG_HZ[1] - slowest) * v
    return float(hz), float(tip / (arm * hz)), float(lag)


def _breaths_hz(mass_kg: float, share: float, style: str, *, is_cat: bool, goes: bool) -> float:
    if style == "pant":
        return 4.0 + 2.0 * share
    least = 20.0 if is_cat else 15.0
    per_minute = float(np.clip(53.5 * mass_kg**-0.26 * (0.75 + 0.4 * share), least, 30.0))
    # Going about takes more air than resting does.
    return per_minute / 60.0 * (1.8 if goes else 1.0)
