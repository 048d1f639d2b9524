"""What moves: postures of bodies, and what any thing is to the radar.

A motion gives a `Pose` at given times, a skin makes `Points` of it: scattering centres and their
cross sections. That is all they know of each other; rooms add echoes, tiers make frames of them.
Room coordinates: x to the right and y away from the radar along the floor, z up from the
floor, in metres. The antenna stands at ``(0, 0, mounting height)``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Label = Literal["human", "pet", "other"]
Ends = tuple[Array, Array]  # both ends of a segment, shape (n_slow, 3) each

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Segments of a body at given times, in room coordinates, each (n_slow, n_segments, 3)."""

    centre_m: Array  # middles
    axis: Array  # unit vectors along the segments
    # Unit vectors square to the axes, to the body's left, perhaps one for all; segments that are
    # round about their axis do not care.
    side: Array

    @classmethod
    def between(cls, ends: Sequence[Ends], side: Array) -> "Pose":
        """Return the pose of segments between joints, in the order of their skeleton."""
        begin = np.stack([a for a, _ in ends], axis=1)
        end = np.stack([b for _, b in ends], axis=1)
        way = end - begin
        size = np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9)
        return cls(0.5 * (begin + end), way / size, side)


def rod(middle_m: Array, axis: Array) -> Ends:
    """Return ends of a segment of which only the middle and the direction count."""
    return middle_m - 0.5 * axis, middle_m + 0.5 * axis


Motion = Callable[[Array], Pose]
"""A body's pose at times of shape (n_slow,), in any order; a function of time alone."""


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
    def label(self) -> Label: ...  # what an alarm should take it for

    @property
    def names(self) -> tuple[str, ...]: ...  # of its points, such as 'left ankle'

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points at times (n_slow,) since its start, the antenna at a place (3,).

        Any times in any order give what they would give alone: there is no state.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """What moves, all of it drawn: points as a function of time; a `Mover`."""

    names: tuple[str, ...]
    at: Callable[[Array, Array], Points]  # of times (n_slow,) and the antenna's place (3,)
    label: Label = "other"
