"""How animals of the first generator carry head and tail, and how they breathe.

Resting breaths follow ``53.5 M^-0.26`` a minute (Stahl 1967, recalled), within what the species
has; panting is at 4 to 6 Hz (recalled).
"""

from dataclasses import dataclass

import numpy as np

from x2radar.sim.bodies.body import Breath
from x2radar.sim.bodies.skeleton.quadrupeds import QuadrupedBuild
from x2radar.sim.bodies.skeleton.species import Band, Species, Swing
from x2radar.sim.bodies.wander import Wander

_WIDEST_WAG_RAD = 1.1
"""A tail does not reach beside the body (recalled)."""


@dataclass(frozen=True, slots=True, eq=False)
class Manner:
    """What an animal does with head, tail and chest."""

    neck_rad: float  # how far the neck points up
    head_rad: float  # and the head
    down_rad: tuple[float, float]  # the same with the nose at the floor
    nod_rad: float  # amplitude of the neck's nod
    gaze: Wander  # what is added to the yaw of neck and head, and to their pitch, in radians
    down: Wander  # one number in -1 to 1; below `down_below` the nose is at the floor
    down_below: float  # -2 for never, 2 for always
    tail_rad: float  # how far the tail points up
    wag_hz: float
    wag_rad: float  # amplitude of the wag
    wag_lag_rad: float  # how far each third of the tail lags behind the one before
    bout: Wander  # one number in -1 to 1; the tail wags where it is above `wag_above`
    wag_above: float  # -2 for always, 2 for never
    breath: Breath
    lick_hz: float  # of the neck's strokes while the nose is down
    lick_rad: float  # their amplitude; 0 for one that does not groom


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
        down=Wander.draw(rng, [1.0], [0.35]),
        down_below=often,
        tail_rad=float(rise),
        wag_hz=wag_hz,
        wag_rad=wag_rad,
        wag_lag_rad=lag,
        bout=Wander.draw(rng, [1.0], [0.4]),
        wag_above=-2.0
        if isinstance(species.tail_moves, Swing)
        else lazy + 0.6 * float(u[4] - 0.5),
        breath=Breath(
            (0.0005 if style == "pant" else 0.0011) * build.mass_kg**0.33 * (0.7 + 0.6 * u[6]),
            _breaths_hz(build.mass_kg, u[5], style, species, goes=not stays or style == "play"),
            2.0 * np.pi * u[7],
        ),
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
