"""What somebody does besides going: with hands, trunk and head, or feet in their place."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REST = np.array([0.10, 0.06, -0.88])
"""A hanging wrist from its shoulder: ahead, outward and up, in lengths of the arm."""
_REACH = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class Doing:
    """What somebody does at given times, besides going.

    Attributes
    ----------
    share : ndarray, shape (n_slow,), float64
        0 for arms that swing or hang, 1 for hands at work.
    shift_m : ndarray, shape (n_slow, 3), float64
        Of the hips, ahead, to the left and up.
    crouch : ndarray, shape (n_slow,), float64
        How much lower the hips are, as a share of the leg.
    lean_rad, twist_rad : ndarray, shape (n_slow,), float64
        Of the trunk, forward, and of the chest, to the left.
    hands : ndarray, shape (n_slow, 2, 3), float64
        Wrists from the shoulders: ahead of the chest, outward and up, in lengths of the arm.
    look_rad : ndarray, shape (n_slow, 2), float64
        Turn of the head to the left, and nod backwards.
    feet_m : ndarray, shape (n_slow, 2, 3), float64
        Feet from where they would stand: ahead, to the left and up.
    """

    share: Array
    shift_m: Array
    crouch: Array
    lean_rad: Array
    twist_rad: Array
    hands: Array
    look_rad: Array
    feet_m: Array


class Doer(Protocol):
    """Somebody's ways; a function of time alone."""

    def at(self, t_s: Array, vigour: Array) -> Doing:
        """Return what is done.

        Parameters
        ----------
        t_s : ndarray, shape (n_slow,), float64
            Times, in seconds.
        vigour : ndarray, shape (n_slow,), float64
            0 standing to 1 at cruising speed: who goes does nothing else.
        """
        ...


def within_reach(hands: Array) -> Array:
    """Return hands of which none is farther from its shoulder than an arm reaches.

    Parameters
    ----------
    hands : ndarray, shape (n_slow, 2, 3), float64
        Left and right, ahead, outward and up, in lengths of the arm.

    Returns
    -------
    ndarray, same shape
        With y to the left instead of outward.
    """
    size = np.linalg.norm(hands, axis=-1, keepdims=True)
    short = hands * np.minimum(1, _REACH / np.maximum(size, 1e-9))
    short[..., 1:2] *= np.array([1.0, -1.0])[:, None]
    return np.asarray(short)
