"""The antennas: where they hang, where they look, how much they see there.

Turns `Points` into `EchoRows`, which is all that the making of frames needs. Both antennas
sit in one place and have one pattern, so a way out and back by the same direction counts
the pattern twice.
"""

from dataclasses import dataclass

import numpy as np

from x2radar.frame import FastTimeAxis
from x2radar.keys import Checked, limited, one_of
from x2radar.sim.points import Array, Points
from x2radar.sim.signal.pulse import NEAREST_M, LinkBudget


@dataclass(frozen=True, slots=True, eq=False)
class EchoRows:
    """Echoes, each as if of one point on the antenna's axis."""

    range_m: Array  # (n_slow, n_rows): half the way out and back
    # (n_slow, n_rows): root of the cross section that a point at `range_m` on the axis needs to
    # give this echo: pattern, reflections and the true spreading of the way are in it. Negative
    # where reflections turned the echo by half a turn.
    root_rcs_m: Array

    def amplitude(self, budget: LinkBudget, axis: FastTimeAxis) -> Array:
        """Return signed peak amplitudes, shape (n_slow, n_rows), in the module's unit."""
        return np.asarray(budget.amplitude(self.range_m, np.ones(1), axis) * self.root_rcs_m)


def length_m(vectors_m: Array) -> Array:
    """Return the lengths of vectors, shape (..., 3), but never less than 0.1 m."""
    squared = np.einsum("...k,...k->...", vectors_m, vectors_m)
    return np.asarray(np.maximum(np.sqrt(squared), NEAREST_M))


@dataclass(frozen=True, slots=True, kw_only=True)
class Antenna(Checked):
    """A pair of antennas side by side; raises SettingsError if a field makes no sense."""

    height_m: float = limited(1.5, 0.05, 10, "mounting height, m")
    tilt_deg: float = limited(0.0, -90, 90, "down from level, degrees")
    pan_deg: float = limited(0.0, -180, 180, "to the right, degrees")
    # Full widths; 65 by 65 for the X2 kit's antennas is recalled.
    azimuth_width_deg: float = limited(65.0, 5, 175, "half-power width, degrees")
    elevation_width_deg: float = limited(65.0, 5, 175, "half-power width, degrees")
    # ``exp(-ln 2 (2 angle / width)^2)``, or none.
    shape: str = one_of("gaussian", ("gaussian", "isotropic"), "pattern")
    # Of power, beside and behind: real antennas of this kind are not below it indoors.
    floor_db: float = limited(-20.0, -60, 0, "least gain, dB")

    @property
    def position_m(self) -> Array:
        """Where they are: ndarray, shape (3,), float64, in room coordinates."""
        return np.array([0.0, 0.0, self.height_m])

    @property
    def axis(self) -> Array:
        """Unit vector along which they look: ndarray, shape (3,), float64."""
        return np.asarray(self._turned()[1])

    def gain(self, towards_m: Array) -> Array:
        """Return the power gain over the axis, `floor_db` to 1, for vectors (..., 3)."""
        if self.shape == "isotropic":
            return np.ones(towards_m.shape[:-1])
        right, ahead, up = np.moveaxis(towards_m @ self._turned().T, -1, 0)
        azimuth = np.arctan2(right, ahead)
        elevation = np.arctan2(up, np.hypot(right, ahead))
        gain = _cut(azimuth, self.azimuth_width_deg)
        gain *= _cut(elevation, self.elevation_width_deg)
        return np.maximum(gain, 10 ** (self.floor_db / 10))

    def direct(self, points: Points, offset_m: Array | None = None) -> EchoRows:
        """Return the echoes straight back, a row a point; the mount is off by (n_slow, 3)."""
        towards_m = points.position_m - self.position_m
        if offset_m is not None:
            towards_m = towards_m - offset_m[:, None]
        root_rcs_m = np.sqrt(points.rcs_m2) * self.gain(towards_m)
        range_m = length_m(towards_m)
        if points.nearer_m is not None:
            range_m = np.maximum(range_m - points.nearer_m, NEAREST_M)
        return EchoRows(range_m, root_rcs_m)

    def _turned(self) -> Array:
        """Return the matrix from room coordinates to right, ahead and up of the antenna."""
        pan, tilt = np.deg2rad([self.pan_deg, self.tilt_deg])
        right = [np.cos(pan), -np.sin(pan), 0.0]
        ahead = [np.sin(pan) * np.cos(tilt), np.cos(pan) * np.cos(tilt), -np.sin(tilt)]
        return np.array([right, ahead, np.cross(right, ahead)])


def _cut(angle: Array, width_deg: float) -> Array:
    return np.asarray(np.exp(-np.log(2) * (angle / (np.deg2rad(width_deg) / 2)) ** 2))
