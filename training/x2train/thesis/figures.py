"""The thesis' example plots of one element: G, mu, D and both vectors (2.5-2.7, 3.7-3.9)."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from radard.dsp.cadence import cadence_velocity_diagram, extent_profile, type1_vector
from radard.dsp.doppler import doppler_hz, micro_doppler
from radard.dsp.gram import gaussian_taper
from x2train.thesis.elements import PROFILE, ElementSpec, dwell
from x2train.thesis.plots import save

_LEAST_DB = -40.0  # as in the thesis' plots
Extent = tuple[float, float, float, float]


def features(folder: Path, spec: ElementSpec, body: str, number: int) -> Path:
    """Draw one element of a body into a folder; return the file."""
    made, _ = dwell(spec, body, number)
    n_cpi, rate_hz = spec.n_cpi, spec.frame_rate_hz
    first = len(made.frames) // 2 - n_cpi // 2
    mu = micro_doppler(made.frames, n_cpi)
    diagram = cadence_velocity_diagram(mu)
    n_columns = mu.shape[1]
    lines = doppler_hz(n_cpi, rate_hz)
    rows = (float(lines[0]), float(lines[-1]))
    range_m = made.axis.range_m
    figure, axes = plt.subplots(2, 3, figsize=(12, 5.6))
    _map(
        axes[0, 0],
        _range_doppler(made.frames[first : first + n_cpi]),
        (range_m[0], range_m[-1], *rows),
        f"G: {body}, {rate_hz} Hz",
        "range (m)",
    )
    _map(axes[0, 1], mu, (0, n_columns / rate_hz, *rows), "µ", "slow time (s)")
    cadences_hz = spec.n_cadence * rate_hz / n_columns
    _map(axes[0, 2], diagram[:, : spec.n_cadence], (0, cadences_hz, *rows), "D", "cadence (Hz)")
    axes[0, 0].set_ylabel("Doppler (Hz)")
    type1 = type1_vector(diagram, spec.n_cadence)
    profile = extent_profile(made.frames, n_cpi, PROFILE)
    axes[1, 0].plot(profile, lw=0.8)
    axes[1, 0].set(title="range profile of the widest extent", xlabel="sample")
    axes[1, 1].plot(type1, lw=0.8)
    axes[1, 1].set(title="type 1 vector", xlabel="element")
    axes[1, 2].plot(np.concatenate([profile, type1]), lw=0.8)
    axes[1, 2].set(title="type 2 vector", xlabel="element")
    figure.tight_layout()
    return save(figure, folder / f"features-{body}-{rate_hz}.png")


def _range_doppler(cpi: NDArray[np.complex64]) -> NDArray[np.float64]:
    """Return the range-Doppler map G of one CPI (2.34), shape (n_cpi, n_range), linear power."""
    moving = cpi - cpi.mean(axis=0, dtype=np.complex128)
    lines = np.fft.fft(moving * gaussian_taper(len(cpi))[:, None], axis=0)
    return np.fft.fftshift(np.abs(lines) ** 2, axes=0)


def _map(axis: Axes, power: NDArray[np.floating], extent: Extent, title: str, label: str) -> None:
    level_db = 10 * np.log10(np.maximum(power / max(float(power.max()), 1e-300), 1e-12))
    axis.imshow(level_db, aspect="auto", origin="lower", extent=extent, vmin=_LEAST_DB, vmax=0)
    axis.set(title=title, xlabel=label)
