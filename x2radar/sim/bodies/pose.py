"""Postures: where the segments of a body are, however it came to be so.

A motion gives a `Pose` at given times, a skin makes echoes of it: that is all they know of each
other.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from x2radar.sim.points import Array

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
