"""What stands still around the radar: objects, distributed clutter, the antennas' leakage.

All levels are those of a baseband bin over the receiver's noise, as measured on real modules. A
frame is a sum of a few fixed profiles, each turned by its own slow drift, so a room of hundreds of
scatterers costs one small matrix product, and a still room nothing at all.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis, Samples
from x2radar.keys import Checked, limited, one_of
from x2radar.sim.points import Array
from x2radar.sim.signal.pulse import LinkBudget, baseband_noise_power, pulse_sigma_s

# Points of distributed clutter a range cell, enough for Rayleigh statistics; directions it
# comes from, echoes of the leak's ringing, sinusoids of a drift, and the slowest of them.
_PER_CELL = 6
_N_SECTORS = 6
_RING_POINTS = 12
_DRIFT_LINES = 4
_SLOWEST_S = 600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RoomSettings(Checked):
    """A room, in levels over noise; None leaves a part out. SettingsError if impossible."""

    # On real UWB modules the strongest static bin lies 49 to 57 dB over the noise; recorded: 47
    # and 54 dB, and 10 to 12 maxima more than 33 dB over it within 4.4 m.
    objects_db: float | None = limited(None, -20, 120, "strongest object over noise, dB")
    # All but the strongest lie up to 20 dB below it.
    n_objects: int = limited(10, 1, 200, "objects", is_whole=True)
    # Recorded: means over half a metre lie at 33 to 37 dB.
    diffuse_db: float | None = limited(None, -40, 100, "distributed clutter at 1 m, dB")
    profile: str = one_of("exponential", ("exponential", "power"), "fall with range")
    # Of the exponential profile; recorded: 0.6 and 1.5 dB/m over 0.5 to 4.4 m.
    decay_db_per_m: float = limited(1.5, 0, 60, "fall with range, dB/m")
    exponent: float = limited(2.0, 0, 8, "fall with range")  # of the power profile
    # Straight from one antenna into the other; its peak.
    leakage_db: float | None = limited(None, -20, 140, "leakage over noise, dB")
    # Half the antennas' distance, and cables.
    leakage_m: float = limited(0.1, 0.0, 2, "where the leakage appears, m")
    ringing_db_per_m: float = limited(80.0, 5, 1000, "fall of the ringing, dB/m")
    # Of strong objects, over ten minutes. Recorded: strong bins turn by 1 to 3 mrad rms within 7
    # s, some by 18 where echoes nearly cancel; 5e-5 to 1e-4 m give that.
    drift_m: float = limited(0.0, 0, 0.005, "slow drift of range, rms, m")
    # Recorded: 0.1 to 0.3 % rms within 7 s, which 0.01 gives; up to 10 % in the first half minute
    # after switching on, which is not modelled.
    drift_gain: float = limited(0.0, 0, 0.2, "slow drift of amplitude, rms")


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Scatterers in one direction: ranges, complex amplitudes, unit vector towards them."""

    range_m: Array
    amplitude: NDArray[np.complex128]
    towards: Array
    drifts: bool


class Room:
    """The static echo of one room, as one axis, RF or baseband, sees it."""

    def __init__(
        self, rng: np.random.Generator, settings: RoomSettings, axis: FastTimeAxis
    ) -> None:
        objects, diffuse, leakage, drift = rng.spawn(4)
        groups = _objects(objects, settings, axis) + _diffuse(diffuse, settings, axis)
        groups += _leakage(leakage, settings)
        n = len(groups)
        noise = math.sqrt(baseband_noise_power(axis, LinkBudget().noise_sigma))
        profiles = np.array([noise * _profile(group, axis) for group in groups], np.complex64)
        self._profiles = profiles.reshape(n, axis.n_range)
        self._towards = np.array([g.towards for g in groups]).reshape(n, 3)
        drifting = np.array([[g.drifts] for g in groups]).reshape(n, 1)
        self._drift_m = settings.drift_m * drifting
        self._drift_gain = settings.drift_gain * drifting
        period_s = _SLOWEST_S * 30 ** -drift.random((2, n, _DRIFT_LINES))
        self._drift_hz = 1 / period_s
        self._drift_turns = drift.random((2, n, _DRIFT_LINES))
        self._turns_per_m = 2 * axis.carrier_hz / SPEED_OF_LIGHT_MPS
        self._is_rf = axis.kind == "rf"
        self.still: NDArray[Any] = self._frames(np.ones((1, n), np.complex64))[0]
        """The echo without drift, shape (n_range,), float32 RF or complex64; read-only."""
        self.still.flags.writeable = False

    def echo(self, t_s: Array, offset_m: Array | None = None) -> Samples:
        """Return the room's echo, (n_slow, n_range), the mount off by `offset_m` (n_slow, 3)."""
        has_drift = bool(self._drift_m.any() or self._drift_gain.any())
        if offset_m is None and not has_drift:
            return np.broadcast_to(self.still, (len(t_s), self.still.size))
        gain, away_m = np.ones((len(t_s), 1)), np.zeros((len(t_s), 1))
        if has_drift:
            # Slow functions of unit rms, shape (n_slow, 2, n_groups).
            turns = t_s[:, None, None, None] * self._drift_hz + self._drift_turns
            lines = np.sin(2 * np.pi * turns).sum(axis=-1) * math.sqrt(2 / _DRIFT_LINES)
            drift = np.moveaxis(lines, 0, 1)
            away_m = drift[0] * self._drift_m.T
            gain = 1 + drift[1] * self._drift_gain.T
        if offset_m is not None:
            away_m = away_m - offset_m @ self._towards.T
        turns = (self._turns_per_m * away_m) % 1.0
        return self._frames((gain * np.exp(-2j * np.pi * turns)).astype(np.complex64))

    def _frames(self, weights: NDArray[np.complex64]) -> Samples:
        if not self._is_rf:
            return np.asarray(weights @ self._profiles)
        real = np.ascontiguousarray(weights.real) @ np.ascontiguousarray(self._profiles.real)
        imag = np.ascontiguousarray(weights.imag) @ np.ascontiguousarray(self._profiles.imag)
        return np.asarray(real - imag)


def _profile(group: _Group, axis: FastTimeAxis) -> NDArray[np.complex128]:
    """Return the group's echo; for RF the analytic signal, whose real part is the echo."""
    sigma_s = pulse_sigma_s(axis.bandwidth_hz)
    out = np.zeros(axis.n_range, np.complex128)
    for range_m, amplitude in zip(group.range_m, group.amplitude, strict=True):
        since_s = 2 * (axis.range_m - range_m) / SPEED_OF_LIGHT_MPS
        if axis.kind == "rf":
            phase = np.exp(2j * np.pi * axis.carrier_hz * since_s)
            out += amplitude * np.exp(-0.5 * (since_s / sigma_s) ** 2) * phase
        else:
            turns = (2 * axis.carrier_hz / SPEED_OF_LIGHT_MPS * range_m) % 1.0
            phasor = amplitude * np.exp(-2j * np.pi * turns)
            out += phasor * np.exp(-0.25 * (since_s / sigma_s) ** 2)
    return out


def _objects(rng: np.random.Generator, settings: RoomSettings, axis: FastTimeAxis) -> list[_Group]:
    if settings.objects_db is None:
        return []
    place, below, turn, pan, tilt = rng.random((5, settings.n_objects))
    below[0] = 0.0
    range_m = axis.range_m[0] + place * (axis.range_m[-1] - axis.range_m[0])
    amplitude = _level(settings.objects_db - 20 * below) * np.exp(2j * np.pi * turn)
    towards = _direction(pan, tilt)
    each = zip(range_m[:, None], amplitude[:, None], towards, strict=True)
    return [_Group(*one, drifts=True) for one in each]


def _diffuse(rng: np.random.Generator, settings: RoomSettings, axis: FastTimeAxis) -> list[_Group]:
    if settings.diffuse_db is None:
        return []
    sigma_m = pulse_sigma_s(axis.bandwidth_hz) * SPEED_OF_LIGHT_MPS / 2
    # A point's energy is that of its peak over so much range.
    cell_m = sigma_m * math.sqrt(2 * math.pi)
    first_m, last_m = axis.range_m[0] - 6 * sigma_m, axis.range_m[-1] + 6 * sigma_m
    n = math.ceil(_PER_CELL * (last_m - first_m) / cell_m)
    range_m = first_m + (last_m - first_m) * (np.arange(n) + rng.random(n)) / n
    range_m = np.maximum(range_m, 0.05)
    real, imag = rng.standard_normal((2, n)) / math.sqrt(2)
    if settings.profile == "power":
        level_db = settings.diffuse_db - 10 * settings.exponent * np.log10(range_m)
    else:
        level_db = settings.diffuse_db - settings.decay_db_per_m * (range_m - 1)
    level = _level(level_db) / math.sqrt(n * cell_m / (last_m - first_m))
    gauss = (level * (real + 1j * imag)).astype(np.complex128)
    towards = _direction(*rng.random((2, _N_SECTORS)))
    return [
        _Group(range_m[k::_N_SECTORS], gauss[k::_N_SECTORS], towards[k], drifts=False)
        for k in range(_N_SECTORS)
    ]


def _leakage(rng: np.random.Generator, settings: RoomSettings) -> list[_Group]:
    """Return the leak and its ringing; it moves with the antennas, so it lies in no direction."""
    if settings.leakage_db is None:
        return []
    behind_m = np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.08, _RING_POINTS))])
    level_db = settings.leakage_db - settings.ringing_db_per_m * behind_m
    turn = np.concatenate([[0.0], rng.random(_RING_POINTS)])
    amplitude = np.asarray(_level(level_db) * np.exp(2j * np.pi * turn), np.complex128)
    return [_Group(settings.leakage_m + behind_m, amplitude, np.zeros(3), drifts=True)]


def _level(level_db: Array) -> Array:
    return np.asarray(10 ** (np.asarray(level_db) / 20))


def _direction(pan: Array, tilt: Array) -> Array:
    """Return unit vectors ahead, within 60 degrees to the sides and 30 up and down."""
    side, up = np.deg2rad(60 * (2 * pan - 1)), np.deg2rad(30 * (2 * tilt - 1))
    level = np.cos(up)
    return np.stack([np.sin(side) * level, np.cos(side) * level, np.sin(up)], axis=-1)
