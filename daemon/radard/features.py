"""Dwell to FeatureSet: the code that the daemon and the training both call.

A bundle's sidecar says which features its network takes and with which settings; a
feature is a row of `FEATURES`. Masked columns of the spectrogram, those whose CPI holds a
lost frame, take the mean of the others, so that they add nothing at any cadence but zero.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.dsp.cadence import cadence_velocity_diagram, extent_profile, type1_vector
from radard.dsp.doppler import micro_doppler
from radard.errors import ModelMismatch
from radard.ring import Dwell


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureSettings:
    """How features are made; part of a bundle's sidecar.

    Attributes
    ----------
    dwell_s : float
        Length of the spectrogram, in seconds.
    n_cpi : int
        Frames in a CPI.
    n_cadence : int
        Columns of the cadence velocity diagram that are used.
    n_profile : int
        Length of the range profile of the type 2 vector.
    range_decimation : int
        Keep every so many range bins behind the matched filter.
    """

    dwell_s: float = 2.0
    n_cpi: int = 28
    n_cadence: int = 28
    n_profile: int = 392
    range_decimation: int = 1

    @classmethod
    def from_mapping(cls, raw: Mapping[str, Any]) -> "FeatureSettings":
        """Read the settings of a sidecar; raise ModelMismatch on an unknown or wrong one."""
        known = {f.name: f.type for f in fields(cls)}
        for key, value in raw.items():
            if key not in known:
                msg = f"features.{key}: unknown setting; this radard is too old for the bundle"
                raise ModelMismatch(msg)
            whole = key != "dwell_s"
            if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
                msg = f"features.{key}: {value!r} is not a number of the right kind"
                raise ModelMismatch(msg)
        return cls(**raw)


@dataclass(frozen=True, slots=True, eq=False)
class FeatureSet:
    """What is known of one dwell.

    Attributes
    ----------
    spectrogram : ndarray, shape (n_cpi, n_seg), float32
        mu, linear power.
    cvd : ndarray, shape (n_cpi, n_seg), float32
        D, magnitude.
    inputs : mapping of str to ndarray, float32
        The features that were asked for, by name.
    """

    spectrogram: NDArray[np.float32]
    cvd: NDArray[np.float32]
    inputs: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    dwell: Dwell
    settings: FeatureSettings
    cvd: NDArray[np.float32]


def _seed_type1(parts: _Parts) -> NDArray[np.float32]:
    return type1_vector(parts.cvd, parts.settings.n_cadence)


def _seed_type2(parts: _Parts) -> NDArray[np.float32]:
    s = parts.settings
    profile = extent_profile(parts.dwell.frames, s.n_cpi, s.n_profile)
    return np.concatenate([profile, _seed_type1(parts)])


FEATURES: Mapping[str, Callable[[_Parts], NDArray[np.float32]]] = {
    "seed_type1": _seed_type1,
    "seed_type2": _seed_type2,
}
"""Every feature that a network may ask for."""


def feature_shape(name: str, settings: FeatureSettings) -> tuple[int, ...]:
    """Return the shape of a feature; raise ModelMismatch if there is no such feature."""
    n_type1 = settings.n_cpi * settings.n_cadence
    shapes = {"seed_type1": (n_type1,), "seed_type2": (n_type1 + settings.n_profile,)}
    if name not in shapes:
        msg = f"feature '{name}': unknown; this radard makes {', '.join(FEATURES)}"
        raise ModelMismatch(msg)
    return shapes[name]


def extract(dwell: Dwell, settings: FeatureSettings, names: tuple[str, ...]) -> FeatureSet:
    """Return the features of one dwell.

    Parameters
    ----------
    dwell : Dwell
        Whole enough to be judged (`Dwell.is_whole`).
    settings : FeatureSettings
        From the bundle.
    names : tuple of str
        Rows of `FEATURES`.

    Returns
    -------
    FeatureSet
        Arrays of its own; nothing points into the dwell.

    Raises
    ------
    FeatureError
        If the dwell is too short for the settings.
    """
    spectrogram = micro_doppler(dwell.frames, settings.n_cpi)
    if dwell.n_lost:
        _mask(spectrogram, dwell.valid, settings.n_cpi)
    cvd = cadence_velocity_diagram(spectrogram)
    parts = _Parts(dwell, settings, cvd)
    return FeatureSet(spectrogram, cvd, {name: FEATURES[name](parts) for name in names})


def _mask(spectrogram: NDArray[np.float32], valid: NDArray[np.bool_], n_cpi: int) -> None:
    """Put the mean of the whole columns in place of those that a lost frame touches."""
    lost = np.concatenate(([0], np.cumsum(~valid)))
    touched = (lost[n_cpi:] - lost[:-n_cpi]) > 0
    if touched.all():
        spectrogram[:] = 0
    else:
        spectrogram[:, touched] = spectrogram[:, ~touched].mean(axis=1, keepdims=True)
