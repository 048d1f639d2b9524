"""Recorded motion as a body: a file's skeleton, put into the room, with any skin."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.motion.recorded import RecordedMotion, read_motion
from x2radar.sim.bodies.skin.base import Skin, TotalRcs, sized
from x2radar.sim.bodies.skin.draw import draw_skin
from x2radar.sim.points import Label, Points

Array = NDArray[np.float64]

_N_POSTURES = 16
"""Over which the mean cross section is taken, as for people."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedBody:
    """A recorded skeleton; see `Mover`."""

    label: Label
    names: tuple[str, ...]
    motion: RecordedMotion
    skin: Skin
    place_m: Array  # (3,): where the file's origin lies in the room
    turn_rad: float  # about the vertical, to the left
    start_s: float

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points; see `Mover`."""
        return self.skin.points(*self.posture(t_s), antenna_m)

    def posture(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return middles, axes and side vectors in the room at times of shape (n_slow,)."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        centre, axis, side = (x @ turn for x in self.motion.posture(t_s - self.start_s))
        return centre + self.place_m, axis, side


def draw_recorded(
    rng: np.random.Generator,
    *,
    file: str,
    label: Label = "human",
    scale: float = 1.0,
    up: str = "y",
    place_m: tuple[float, float] = (0.0, 0.0),
    turn_deg: float = 0.0,
    start_s: float = 0.0,
    total_rcs_dbsm: TotalRcs = None,
    skin: str = "surface",
) -> RecordedBody:
    """Draw the skin of a recorded skeleton.

    Parameters
    ----------
    rng : numpy.random.Generator
        Of the skin.
    file, scale, up
        As `read_motion` takes them.
    label : {'human', 'pet', 'other'}
        What an alarm should take it for.
    place_m, turn_deg
        Where the file's origin lies, and how far it is turned to the left.
    start_s : float
        When the recording begins; the body stands in its first posture before.
    total_rcs_dbsm, skin
        As in `draw_person`.

    Raises
    ------
    SceneError
        As `read_motion` and `draw_skin`.
    """
    motion = read_motion(file, scale=scale, up=up)
    drawn = draw_skin(rng, skin, motion.half_m)
    times = np.linspace(0.0, motion.duration_s, _N_POSTURES)
    drawn = sized(drawn, rng, total_rcs_dbsm, motion.posture(times))
    place = np.array([*place_m, 0.0])
    names = drawn.names(motion.names)
    return RecordedBody(label, names, motion, drawn, place, float(np.deg2rad(turn_deg)), start_s)
