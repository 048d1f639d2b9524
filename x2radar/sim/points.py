"""What a moving thing is to the radar: scattering centres and their cross sections over time.

Bodies and moving things all give `Points`; rooms add echoes, tiers make frames of them.
Room coordinates: x to the right and y away from the radar along the floor, z up from the
floor, in metres. The antenna stands at ``(0, 0, mounting height)``.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Label = Literal["human", "pet", "other"]


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Scattering centres of one thing at given times."""

    position_m: Array  # (n_slow, n_points, 3): in room coordinates
    # (n_slow, n_points): monostatic cross section towards the antenna; aspect, fluctuation and
    # shadowing included, antenna pattern and multipath not; 0 for a point that is not there.
    rcs_m2: Array
    # (n_slow, n_points): how much nearer than its position a point echoes: the depth of a surface
    # before the middle of a part; None is nothing.
    nearer_m: Array | None = None


class Mover(Protocol):
    """A thing that moves; everything random about it was drawn when it was made."""

    @property
    def label(self) -> Label:
        """What an alarm should take it for."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its points, such as 'left ankle'."""
        ...

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points at times (n_slow,) since its start, the antenna at a place (3,).

        Any times in any order give what they would give alone: there is no state.
        """
        ...
