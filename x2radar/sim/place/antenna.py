"""The antennas, and the ways of echoes to them: straight, by floor and walls, behind a body.

Each turns `Points` into `EchoRows`, which is all that the making of frames needs, frame by frame
without state. Both antennas sit in one place and have one pattern, so a way out and back by the
same direction counts the pattern twice. Left out: ways by two different surfaces, the shadow of a
body on the clutter behind it, and that a body's cross section differs between directions (the
monostatic one, and the depth of its surface, are used).

Lengths are those of the image method: a plane mirrors the antenna, and the way by the plane
is as long as the straight way to the image.
"""

import math
from collections.abc import Iterator
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


_AXES = {"x": 0, "y": 1, "z": 2}
_CLEAR_M = 0.3  # nearer things count as here, since bodies are no points
# Where the body stood, and how far behind it the tail was measured; see `TailSettings`.
_CALIBRATED_AT_M = 1.7
_GAP_M = (0.4, 3.0)
# Points of a body with aspects of their own, more than any has parts; places drawn for each
# that is taken, so many that the antenna's beam is filled.
_N_ASPECTS = 64
_PLACES_A_PATH = 20
_TINY = 1e-300


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface(Checked):
    """A large flat reflector: floor, ceiling or wall."""

    axis: str = one_of("z", tuple(_AXES), "axis across the surface")
    at_m: float = limited(0.0, -100, 100, "position on the axis, m")
    # Floorboard 3.66, concrete 5.3, plasterboard 2.9, wood 2.0 (ITU-R P.2040, recalled).
    permittivity: float = limited(3.66, 1, 100, "relative permittivity")
    smoothness: float = limited(1.0, 0, 1, "share of amplitude left in the mirror direction")

    def reflection(self, cos_incidence: Array) -> Array:
        """Return the signed amplitude reflection (Fresnel), polarised upright; `cosine` 0 to 1."""
        transmitted = np.sqrt(self.permittivity - 1 + cos_incidence**2)
        weight = self.permittivity if self.axis == "z" else 1.0
        front = weight * cos_incidence
        return np.asarray(self.smoothness * (front - transmitted) / (front + transmitted))


def image_rows(points: Points, antenna: Antenna, surface: Surface) -> EchoRows:
    """Return the echoes of points by way of one surface.

    First one row a point for out or back by the surface (both orders come in together, so twice
    the amplitude), half of ``R + R'`` long, R' being the way to the image; then one row a point
    for out and back by it, R' long. The antenna's pattern counts in the directions in which the
    ways leave; points on the surface's far side give no echo.
    """
    k = _AXES[surface.axis]
    here = antenna.position_m
    straight = points.position_m - here
    # The same way seen from the antenna: towards the mirrored point.
    bounced = straight.copy()
    bounced[..., k] = 2 * surface.at_m - points.position_m[..., k] - here[k]
    near_m, far_m = length_m(straight), length_m(bounced)
    turned = surface.reflection(np.abs(bounced[..., k]) / far_m)
    if points.nearer_m is not None:
        near_m = np.maximum(near_m - points.nearer_m, NEAREST_M)
        far_m = np.maximum(far_m - points.nearer_m, NEAREST_M)
    is_inside = (points.position_m[..., k] - surface.at_m) * (here[k] - surface.at_m) > 0
    root = np.where(is_inside, np.sqrt(points.rcs_m2), 0.0) * turned
    gain_straight, gain_by = antenna.gain(straight), antenna.gain(bounced)
    one_m = (near_m + far_m) / 2
    # Against the radar equation at `one_m`: two ways, and 1 / (R R') for 1 / range^2.
    once = 2 * root * np.sqrt(gain_straight * gain_by) * one_m**2 / (near_m * far_m)
    twice = root * turned * gain_by
    return EchoRows(np.concatenate([one_m, far_m], axis=1), np.concatenate([once, twice], axis=1))


@dataclass(frozen=True, slots=True, kw_only=True)
class TailSettings(Checked):
    """The moving clutter that fills the range behind a body.

    Between a body and the static things around it echoes go both ways: antenna, body, thing,
    antenna, and back. Measured in two recorded walks (P4xx module, 3.1-5.3 GHz, a 4 x 4 m room,
    680 and 370 frames of 33 ms, body at 0.5 to 3.3 m, slow time high-passed at 1 s): the tail
    reaches 3.9 m behind the body; its mean power is 14 dB (10 to 15) under the body's peak at +0.5
    to +1 m, 18 at +1.5, 21 at +2, 24 at +2.5, 25 at +3 and 27 at +3.5 m; at one absolute range it
    hardly depends on where the body is (16 dB over noise +-2 at 3.5 m); beyond +0.4 m it holds 5
    dB less energy than the body; its mean Doppler is half to three quarters of the body's
    (antennas that see all round; with a beam this model gives a fifth to a half).
    """

    # From 0.4 to 3 m behind a body 1.7 m ahead of the antenna. What was measured holds floor and
    # wall echoes too; with those named as well, take some 2 dB less.
    energy_db: float = limited(-5.0, -60, 10, "tail energy against the body's, dB")
    # 128 within 4 m are 2 to 4 in a range cell (8 cm) behind a body.
    n_paths: int = limited(128, 16, 4096, "ways", is_whole=True)
    # Static things lie all over the disc of this radius around the antenna, with even power. Those
    # beyond the swath's end never show, so it is best set there.
    reach_m: float = limited(4.0, 0.5, 30, "radius of the things around, m")
    ceiling_m: float = limited(2.5, 0.5, 20, "height of the things around, m")
    # No thing lies nearer to the antenna, and none counts as nearer to a body.
    free_m: float = limited(0.0, 0, 10, "free floor about antenna and bodies, m")

    def faults_together(self) -> Iterator[str]:
        """Yield that nothing is around, where that is so."""
        if self.free_m >= self.reach_m:
            yield f"free_m: {self.free_m:g} leaves nothing within reach_m, {self.reach_m:g}"


class DiffuseTail:
    """Ways between a body and the static things around it, all drawn when it is made."""

    def __init__(self, rng: np.random.Generator, settings: TailSettings, antenna: Antenna) -> None:
        n = settings.n_paths
        self._antenna = antenna
        self._clear_m = max(_CLEAR_M, settings.free_m)
        # Things are drawn by the antenna's gain.
        n_places = _PLACES_A_PATH * n
        radius, turn, height = rng.random((3, n_places))
        radius = settings.free_m + (settings.reach_m - settings.free_m) * radius
        x, y = radius * np.sin(2 * np.pi * turn), radius * np.cos(2 * np.pi * turn)
        place_m = np.stack([x, y, settings.ceiling_m * height], axis=1)
        gain = antenna.gain(place_m - antenna.position_m)
        taken = rng.choice(n_places, n, replace=False, p=gain / gain.sum())
        self._thing_m = place_m[taken]
        self._aspect = np.exp(rng.standard_normal((_N_ASPECTS, n)))
        self._out_m = np.maximum(length_m(self._thing_m - antenna.position_m), _CLEAR_M)
        # Evenly in radius they are too many near by; by their power it is evenly in area.
        away_m = np.hypot(self._thing_m[:, 0], self._thing_m[:, 1])
        self._root = np.sqrt(rng.exponential(size=n) * away_m)
        self._root *= 10 ** (settings.energy_db / 20) / np.sqrt(self._calibration())

    def rows(self, points: Points) -> EchoRows:
        """Return a body's echoes by static things, (R_body + d + R_thing) / 2, one row a way."""
        n_points = points.rcs_m2.shape[1]
        aspect = self._aspect[np.arange(n_points) % _N_ASPECTS]
        total = points.rcs_m2 @ aspect
        # A body without any cross section is nowhere; its rows are zero wherever they lie.
        share = 1 / np.maximum(total, _TINY)
        here = self._antenna.position_m
        near_sq, between_sq = np.zeros_like(total), np.zeros_like(total)
        for k in range(3):
            body_m = (points.position_m[..., k] * points.rcs_m2) @ aspect * share
            near_sq += (body_m - here[k]) ** 2
            between_sq += (body_m - self._thing_m[:, k]) ** 2
        near_m = np.sqrt(np.maximum(near_sq, NEAREST_M**2))
        between_m = np.sqrt(np.maximum(between_sq, self._clear_m**2))
        range_m = (near_m + between_m + self._out_m) / 2
        weight = points.rcs_m2 / np.maximum(points.rcs_m2.sum(axis=1, keepdims=True), _TINY)
        centre_m = np.einsum("tpk,tp->tk", points.position_m, weight)
        gain = self._antenna.gain(centre_m - here)[:, None]
        # Log-normal weights of unit sigma have the mean sqrt(e).
        root = self._root * np.sqrt(total * (gain / math.sqrt(math.e)))
        return EchoRows(range_m, root * range_m**2 / (near_m * between_m * self._out_m))

    def _calibration(self) -> float:
        """Return the tail's energy over the body's, as drawn, for a body ahead."""
        ahead = self._antenna.position_m + _CALIBRATED_AT_M * self._antenna.axis
        between_m = np.maximum(length_m(ahead - self._thing_m), self._clear_m)
        behind_m = (between_m + self._out_m - _CALIBRATED_AT_M) / 2
        ratio = (self._root * _CALIBRATED_AT_M / (between_m * self._out_m)) ** 2
        is_tail = (behind_m > _GAP_M[0]) & (behind_m < _GAP_M[1])
        return float(ratio[is_tail].sum() or ratio.sum())
