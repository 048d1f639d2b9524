"""Limbs of two links: from both ends to the joint between, or from angles to the ends."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STRETCHED = 0.995
"""Share of a limb's length that it can reach: a straight joint would snap (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What all limbs of a body share at given times, each of shape (n_slow,) but the last."""

    facing_rad: Array
    yaw_rad: Array  # of the pelvis
    phase: Array  # strides done
    vigour: Array  # 0 standing to 1 at cruising speed
    gesture: Array  # (n_slow, n_angles)


def direction(yaw_rad: Array, pitch_rad: Array) -> Array:
    """Return unit vectors, shape (..., 3), of a yaw and an upward pitch."""
    level = np.cos(pitch_rad)
    return np.stack([level * np.cos(yaw_rad), level * np.sin(yaw_rad), np.sin(pitch_rad)], axis=-1)


def bent(
    top_m: Array, end_m: Array, upper_m: float, lower_m: float, towards: Array
) -> tuple[Array, Array]:
    """Return the middle joint of a limb, and its end as far as the limb reaches.

    Parameters
    ----------
    top_m, end_m : ndarray, shape (n_slow, 3), float64
        Where the limb hangs and where its end shall be.
    upper_m, lower_m : float
        Lengths of the links.
    towards : ndarray, shape (n_slow, 3), float64
        To which side the joint bends; unit vectors.
    """
    reach = end_m - top_m
    distance = np.maximum(np.linalg.norm(reach, axis=-1, keepdims=True), 1e-6)
    unit = reach / distance
    span = np.clip(
        distance, 1.05 * abs(upper_m - lower_m) + 1e-3, _STRETCHED * (upper_m + lower_m)
    )
    along = (upper_m**2 - lower_m**2 + span**2) / (2.0 * span)
    aside = np.sqrt(np.maximum(upper_m**2 - along**2, 0.0))
    bend = towards - (towards * unit).sum(axis=-1, keepdims=True) * unit
    bend /= np.maximum(np.linalg.norm(bend, axis=-1, keepdims=True), 1e-6)
    return top_m + along * unit + aside * bend, top_m + span * unit


def hung(
    top_m: Array, yaw_rad: Array, angle_rad: Array, length_m: float, splay_rad: float = 0.0
) -> Array:
    """Return the lower end of a link that hangs at an angle, forward positive, from the vertical.

    `splay_rad` takes it to the left. Shapes (n_slow, 3) and (n_slow,).
    """
    ahead = direction(yaw_rad, np.zeros_like(yaw_rad))
    left = direction(yaw_rad + 0.5 * np.pi, np.zeros_like(yaw_rad))
    down = np.array([0.0, 0.0, -1.0])
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    link = np.cos(splay_rad) * (cos * down + sin * ahead) + np.sin(splay_rad) * left
    return np.asarray(top_m + length_m * link, dtype=np.float64)


def segments(ends: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return middles and axes, shape (n_slow, n_segments, 3), of segments between ends."""
    begin = np.stack([a for a, _ in ends], axis=1)
    end = np.stack([b for _, b in ends], axis=1)
    way = end - begin
    size = np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9)
    return 0.5 * (begin + end), way / size
