"""Pictures of single elements (figures 2.5 to 2.7, 3.7 to 3.9)."""

import io
from itertools import count
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from radard.dsp.cadence import cadence_velocity_diagram, extent_profile, type1_vector
from radard.dsp.doppler import doppler_hz, micro_doppler
from radard.dsp.downconvert import DownConverter
from radard.dsp.gram import gaussian_taper
from x2radar.atomic import write_whole
from x2radar.frame import FastTimeAxis
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS
from x2radar.sim.echo import frames as echo_frames
from x2train.thesis.elements import BODIES, PROFILE, ElementSpec, dwell, scatterers

_MIN_DB = -40.0  # as in the thesis' plots
_NEAR_M, _FAR_M = 1.5, 3.0  # of the torso in the elements that are drawn
_Extent = tuple[float, float, float, float]
# Figure 2.5: fp, M, fs, ts and fc, and five scatterers between 2.5 and 3 m at its two velocities.
_FP_HZ, _M, _FS_HZ, _TS_S, _FC_HZ = 200.0, 20, 41e9, 6e-9, 6.8e9
_N_FAST, _BANDWIDTH_HZ = 768, 2.3e9
_RANGES_M = (2.55, 2.7, 2.9, 2.6, 2.8)
_VELOCITIES_MPS = (0.9, 0.9, 0.9, -1.5, -1.5)


def save(figure: Figure, path: Path) -> Path:
    """Write a figure without a date, so that the same data gives the same file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = io.BytesIO()
    figure.savefig(picture, dpi=70, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)
    write_whole(path, picture.getvalue())
    return path


def features(folder: Path, spec: ElementSpec, body: str) -> Path:
    """Draw an element of a body, in view all the time, into a folder; return the file."""
    number = next(k for k in count() if _is_in_view(spec, body, k))
    made, _ = dwell(spec, body, number)
    n_cpi, rate_hz, range_m = spec.n_cpi, spec.frame_rate_hz, made.axis.range_m
    first = len(made.frames) // 2 - n_cpi // 2
    mu = micro_doppler(made.frames, n_cpi)
    diagram = cadence_velocity_diagram(mu)
    lines = doppler_hz(n_cpi, rate_hz)
    rows = (float(lines[0]), float(lines[-1]))
    figure, axes = plt.subplots(2, 3, figsize=(13, 6), layout="constrained")
    figure.suptitle(f"{body}, {rate_hz} Hz, element {number}")
    middle = _range_doppler(made.frames[first : first + n_cpi])
    _map(axes[0, 0], middle, (range_m[0], range_m[-1], *rows), "G, middle CPI", "range (m)")
    _map(axes[0, 1], mu, (0, mu.shape[1] / rate_hz, *rows), "µ", "slow time (s)")
    cadences = (0, spec.n_cadence / spec.dwell_s, *rows)
    _map(axes[0, 2], diagram[:, : spec.n_cadence], cadences, "D", "cadence (Hz)")
    type1 = type1_vector(diagram, spec.n_cadence)
    profile = extent_profile(made.frames, n_cpi, PROFILE)
    extent_m = np.arange(PROFILE) * made.axis.bin_length_m
    axes[1, 0].plot(extent_m, profile, lw=0.8)
    axes[1, 0].set(
        title="range profile of the widest extent",
        xlabel="behind its first sample (m)",
        ylabel="amplitude, of its peak",
    )
    for axis, vector, name in (
        (axes[1, 1], type1, "type 1 vector"),
        (axes[1, 2], np.concatenate([profile, type1]), "type 2 vector"),
    ):
        axis.plot(vector, lw=0.8)
        axis.set(title=name, xlabel="element", ylabel="value")
    return save(figure, folder / f"features-{body}-{rate_hz}.png")


def _is_in_view(spec: ElementSpec, body: str, number: int) -> bool:
    """Return whether an element's torso stays where the radar sees it well."""
    torso_m = scatterers(spec, body, number)[0][:, 0]
    return bool(torso_m.min() > _NEAR_M and torso_m.max() < _FAR_M)


def _range_doppler(cpi: NDArray[np.complex64]) -> NDArray[np.float64]:
    """Return the range-Doppler map G of one CPI (2.34), shape (n_cpi, n_range), linear power."""
    moving = cpi - cpi.mean(axis=0, dtype=np.complex128)
    lines = np.fft.fft(moving * gaussian_taper(len(cpi))[:, None], axis=0)
    return np.fft.fftshift(np.abs(lines) ** 2, axes=0)


def _map(axis: Axes, power: NDArray[np.floating], extent: _Extent, title: str, label: str) -> None:
    level_db = 10 * np.log10(np.maximum(power / max(float(power.max()), 1e-300), 1e-12))
    image = axis.imshow(
        level_db, aspect="auto", origin="lower", extent=extent, vmin=_MIN_DB, vmax=0
    )
    axis.figure.colorbar(image, ax=axis, label="dB under the peak")
    axis.set(title=title, xlabel=label, ylabel="Doppler (Hz)")


def five_scatterers(path: Path) -> Path:
    """Draw the range-Doppler map of five points as figure 2.5's text says them."""
    axis = FastTimeAxis(
        kind="rf",
        n_range=_N_FAST,
        bin_length_m=SPEED_OF_LIGHT_MPS / (2 * _FS_HZ),
        range_offset_m=SPEED_OF_LIGHT_MPS * _TS_S / 2,
        carrier_hz=_FC_HZ,
        bandwidth_hz=_BANDWIDTH_HZ,
        sample_rate_hz=_FS_HZ,
    )
    t_s = np.arange(_M) / _FP_HZ
    range_m = np.array(_RANGES_M) + t_s[:, None] * np.array(_VELOCITIES_MPS)
    converter = DownConverter(axis)
    rf = echo_frames(range_m, np.ones_like(range_m), axis, error_db=-100.0)
    power, bins_m = _range_doppler(converter.convert(rf)), converter.axis.range_m
    lines = doppler_hz(_M, _FP_HZ)
    extent = (float(bins_m[0]), float(bins_m[-1]), float(lines[0]), float(lines[-1]))
    figure, ax = plt.subplots(figsize=(6, 3.4), layout="constrained")
    title = f"G of five scatterers: fp = {_FP_HZ:g} Hz, M = {_M}, ts = {1e9 * _TS_S:g} ns"
    _map(ax, power, extent, title, "range (m)")
    return save(figure, path)


def profiles(path: Path, spec: ElementSpec) -> Path:
    """Draw the widest extent of an element of every body, with its scatterers: 3.8 and 3.9."""
    figure, axes = plt.subplots(1, len(BODIES), figsize=(13, 3), layout="constrained")
    for ax, body in zip(axes, BODIES, strict=True):
        number = next(k for k in count() if _is_in_view(spec, body, k))
        made, _ = dwell(spec, body, number)
        at = len(made.frames) // 2
        range_m = scatterers(spec, body, number)[0][at]
        amplitude = np.abs(made.frames[at])
        near, far = float(range_m.min()) - 0.3, float(range_m.max()) + 0.3
        ax.plot(made.axis.range_m, amplitude / amplitude.max(), lw=0.8)
        ax.plot(range_m[1:], np.zeros(len(range_m) - 1), "k|", ms=14, label="limbs")
        ax.plot(range_m[0], 0.0, "r^", label="torso")
        ax.set(
            title=f"{body}, middle of element {number}",
            xlabel="range (m)",
            ylabel="amplitude, of its peak",
            xlim=(near, far),
        )
    axes[0].legend()
    return save(figure, path)
