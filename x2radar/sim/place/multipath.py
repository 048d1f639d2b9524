"""Ways of an echo that are not straight: floor, walls, and the clutter behind a body.

Every effect turns the `Points` of one thing into further `EchoRows`, frame by frame without
state, and costs nothing when it is not asked for. Left out: ways by two different surfaces,
the shadow of a body on the clutter behind it, and that a body's cross section differs
between directions (the monostatic one, and the depth of its surface, are used).

Lengths are those of the image method: a plane mirrors the antenna, and the way by the plane
is as long as the straight way to the image.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from x2radar.keys import Checked, limited, one_of
from x2radar.sim.place.antenna import Antenna, EchoRows, length_m
from x2radar.sim.points import Array, Points
from x2radar.sim.signal.pulse import NEAREST_M

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
        self._thing_m = _draw_things(rng, settings, antenna)
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


def _draw_things(rng: np.random.Generator, settings: TailSettings, antenna: Antenna) -> Array:
    """Return the places of the static things, by the antenna's gain, shape (n_paths, 3)."""
    n_places = _PLACES_A_PATH * settings.n_paths
    radius, turn, height = rng.random((3, n_places))
    radius = settings.free_m + (settings.reach_m - settings.free_m) * radius
    x, y = radius * np.sin(2 * np.pi * turn), radius * np.cos(2 * np.pi * turn)
    place_m = np.stack([x, y, settings.ceiling_m * height], axis=1)
    gain = antenna.gain(place_m - antenna.position_m)
    taken = rng.choice(n_places, settings.n_paths, replace=False, p=gain / gain.sum())
    return np.asarray(place_m[taken])
