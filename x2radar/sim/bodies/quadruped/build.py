"""What a four-legged animal is like: its parts, their sizes, and its manners."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.quadruped.gait import LEGS
from x2radar.sim.bodies.skin.base import Loudness

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
"""Parts of the body, in order."""
_ENDS = tuple(
    k for k, part in enumerate(NAMES) if part in TAIL or part.endswith(("lower leg", "paw"))
)
LOUDNESS = Loudness(most_power=0.0, losses=((tuple(range(len(TRUNK))), 5.0), (_ENDS, 10.0)))
"""Legs are slender, and a recorded dog shows less of its paws than of its thighs."""


@dataclass(frozen=True, slots=True)
class QuadrupedBuild:
    """Sizes of an animal, in metres but for its mass."""

    mass_kg: float
    hip_m: float  # height of the hip, standing
    back_m: float  # from hip to shoulder
    half_width_m: float  # of the trunk
    half_depth_m: float
    neck_m: float
    head_m: float
    tail_m: float
    upper_m: float  # upper link of a leg; both together are longer than `hip_m`
    lower_m: float
    paw_m: float  # length of a paw; its middle is half its height over the sole
    half_track_m: float  # half the distance between left and right feet

    def half_lengths(self) -> list[tuple[float, float, float]]:
        """Return half-lengths of all parts, as `draw_skin` takes them."""
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
    breath_hz: float
    breath_m: float  # how far the chest's surface moves either way
    breath_rad: float  # phase at time 0
    lick_hz: float = 0.0  # of the neck's strokes while the nose is down
    lick_rad: float = 0.0  # their amplitude
