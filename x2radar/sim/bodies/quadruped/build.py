"""What a four-legged animal is like: its parts, their sizes, and its manners."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.quadruped.gait import LEGS

Array = NDArray[np.float64]

TRUNK = ("trunk", "chest", "rump")
FRONT = ("neck", "head")
TAIL = ("tail base", "tail middle", "tail tip")
NAMES = (
    *TRUNK,
    *FRONT,
    *TAIL,
    *(f"{leg} {part}" for leg in LEGS for part in ("upper leg", "lower leg", "paw")),
)
N_PARTS = len(NAMES)
"""Parts of the body, in order."""


@dataclass(frozen=True, slots=True)
class QuadrupedBuild:
    """Sizes of an animal, in metres but for its mass.

    Attributes
    ----------
    mass_kg : float
        Mass.
    hip_m : float
        Height of the hip, standing.
    back_m : float
        From hip to shoulder.
    half_width_m, half_depth_m : float
        Half the trunk's width and depth.
    neck_m, head_m, tail_m : float
        Lengths.
    upper_m, lower_m : float
        Lengths of the two links of a leg; together more than `hip_m`.
    paw_m : float
        Length of a paw; its middle is half its height over the sole.
    half_track_m : float
        Half the distance between left and right feet.
    """

    mass_kg: float
    hip_m: float
    back_m: float
    half_width_m: float
    half_depth_m: float
    neck_m: float
    head_m: float
    tail_m: float
    upper_m: float
    lower_m: float
    paw_m: float
    half_track_m: float

    def half_lengths(self) -> list[tuple[float, float, float]]:
        """Return half-lengths of all parts, as `SegmentRcs.draw` takes them."""
        w, d = self.half_width_m, self.half_depth_m
        thick = 0.045 * self.hip_m
        tail = (self.tail_m / 6, 0.025 * self.hip_m, 0.025 * self.hip_m)
        leg = [
            (0.5 * self.upper_m, 1.5 * thick, 1.5 * thick),
            (0.5 * self.lower_m, 0.7 * thick, 0.7 * thick),
            (0.5 * self.paw_m, 0.3 * self.paw_m, 0.3 * self.paw_m),
        ]
        return [
            (0.58 * self.back_m, w, d),
            (0.95 * d, 0.95 * w, d),
            (0.8 * d, 0.9 * w, 0.85 * d),
            (0.55 * self.neck_m, 0.55 * w, 0.55 * w),
            (0.5 * self.head_m, 0.3 * self.head_m, 0.3 * self.head_m),
            *(tail,) * 3,
            *leg * 4,
        ]


@dataclass(frozen=True, slots=True, eq=False)
class Manner:
    """What an animal does with head, tail and chest.

    Attributes
    ----------
    neck_rad, head_rad : float
        How far neck and head point up.
    down_rad : tuple of float
        How far neck and head point up with the nose at the floor.
    nod_rad : float
        Amplitude of the neck's nod.
    gaze : Wander
        What is added to the yaw of neck and head, and to their pitch, in radians.
    down : Wander
        One number in -1 to 1; below `down_below` the nose is at the floor.
    down_below : float
        -2 for never, 2 for always.
    tail_rad : float
        How far the tail points up.
    wag_hz, wag_rad, wag_lag_rad : float
        Frequency and amplitude of the wag, and how far each third of the tail lags behind
        the one before.
    bout : Wander
        One number in -1 to 1; the tail wags where it is above `wag_above`.
    wag_above : float
        -2 for always, 2 for never.
    breath_hz, breath_m : float
        Breathing, and how far the chest's surface moves either way.
    breath_rad : float
        Phase at time 0.
    lick_hz, lick_rad : float
        Frequency and amplitude of the neck's strokes while the nose is down.
    """

    neck_rad: float
    head_rad: float
    down_rad: tuple[float, float]
    nod_rad: float
    gaze: Wander
    down: Wander
    down_below: float
    tail_rad: float
    wag_hz: float
    wag_rad: float
    wag_lag_rad: float
    bout: Wander
    wag_above: float
    breath_hz: float
    breath_m: float
    breath_rad: float
    lick_hz: float = 0.0
    lick_rad: float = 0.0
