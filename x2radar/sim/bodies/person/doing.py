"""What somebody does besides going: with hands, trunk and head, or feet in their place."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REST = np.array([0.10, 0.06, -0.88])
"""A hanging wrist from its shoulder: ahead, outward and up, in lengths of the arm."""
_REACH = 0.9
"""Farthest wrist, in lengths of the arm: it stays a little bent (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class Doing:
    """What somebody does at given times, besides going."""

    share: Array  # (n_slow,): 0 for arms that swing or hang, 1 for hands at work
    shift_m: Array  # (n_slow, 3): of the hips, ahead, to the left and up
    crouch: Array  # (n_slow,): how much lower the hips are, as a share of the leg
    lean_rad: Array  # (n_slow,): of the trunk, forward
    twist_rad: Array  # (n_slow,): of the chest, to the left
    hands: Array  # (n_slow, 2, 3): wrists from the shoulders, as `within_reach` returns them
    look_rad: Array  # (n_slow, 2): turn of the head to the left, and nod backwards
    feet_m: Array  # (n_slow, 2, 3): feet from where they would stand: ahead, to the left and up


class Doer(Protocol):
    """Somebody's ways; a function of time alone."""

    def at(self, t_s: Array, vigour: Array) -> Doing:
        """Return what is done at times of shape (n_slow,).

        `vigour` is 0 standing to 1 at cruising speed: a person who goes does nothing else.
        """
        ...


def within_reach(hands: Array) -> Array:
    """Return hands of which none is farther from its shoulder than an arm reaches.

    Shape (n_slow, 2, 3), left and right: ahead, outward and up, in lengths of the arm. In what
    is returned the second is to the left for both.
    """
    size = np.linalg.norm(hands, axis=-1, keepdims=True)
    short = hands * np.minimum(1, _REACH / np.maximum(size, 1e-9))
    short[..., 1:2] *= np.array([1.0, -1.0])[:, None]
    return np.asarray(short)
