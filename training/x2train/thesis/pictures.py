"""The page and its pictures (figures 2.3 to 5.2): elements, bodies, pulse and results."""

import io
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

mpl.use("Agg")

import matplotlib.pyplot as plt
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from radard.dsp.cadence import cadence_velocity_diagram, extent_profile, type1_vector
from radard.dsp.doppler import doppler_hz, gaussian_taper, micro_doppler
from radard.dsp.downconvert import DownConverter
from radard.stream.ring import Dwell
from x2radar.atomic import write_whole
from x2radar.errors import WriteError
from x2radar.frame import SPEED_OF_LIGHT_MPS
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES, ranges_xyz
from x2radar.sim.echo import frames as echo_frames
from x2radar.sim.signal.pulse import pulse_sigma_s
from x2train.thesis.elements import BODIES, PROFILE, ElementSpec, dwell, scatterers
from x2train.thesis.fit import ACTIVATIONS
from x2train.thesis.page import MAIN, page
from x2train.thesis.recipe import CellResult, StudyRecipe
from x2train.thesis.sets import RATES_HZ

_CLASSES = ("pet", "person")
_Extent = tuple[float, float, float, float]
_MOVED_S = 0.3  # limbs are apart
_MIN_DB = -40.0  # as in the thesis' plots
_NEAR_M, _FAR_M = 1.5, 3.0  # of the torso in the elements that are drawn
_X2 = RadarSettings().axis
# Figure 2.5: fp, M and ts, and five scatterers between 2.5 and 3 m at its two velocities.
_FP_HZ, _M, _TS_S = 200.0, 20, 6e-9
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
    number, made = _in_view(spec, body)
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
    type2 = np.concatenate([profile, type1])
    axes[1, 0].plot(np.arange(PROFILE) * made.axis.bin_length_m, profile, lw=0.8)
    axes[1, 1].plot(type1, lw=0.8)
    axes[1, 2].plot(type2, lw=0.8)
    title, xlabel = "range profile of the widest extent", "behind its first sample (m)"
    axes[1, 0].set(title=title, xlabel=xlabel, ylabel="amplitude, of its peak")
    axes[1, 1].set(title="type 1 vector", xlabel="element", ylabel="value")
    axes[1, 2].set(title="type 2 vector", xlabel="element", ylabel="value")
    return save(figure, folder / f"features-{body}-{rate_hz}.png")


def _in_view(spec: ElementSpec, body: str) -> tuple[int, Dwell]:
    """Return the first element whose torso stays where the radar sees it well, and its number."""
    ways_m = (scatterers(spec, body, k)[0][:, 0] for k in count())
    found = (k for k, m in enumerate(ways_m) if m.min() > _NEAR_M and m.max() < _FAR_M)
    number = next(found)
    return number, dwell(spec, body, number)[0]


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
    axis = replace(_X2, range_offset_m=SPEED_OF_LIGHT_MPS * _TS_S / 2)
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
        number, made = _in_view(spec, body)
        at = len(made.frames) // 2
        range_m = scatterers(spec, body, number)[0][at]
        amplitude = np.abs(made.frames[at])
        near, far = float(range_m.min()) - 0.3, float(range_m.max()) + 0.3
        ax.plot(made.axis.range_m, amplitude / amplitude.max(), lw=0.8)
        ax.plot(range_m[1:], np.zeros(len(range_m) - 1), "k|", ms=14, label="limbs")
        ax.plot(range_m[0], 0.0, "r^", label="torso")
        ax.set(title=f"{body}, middle of element {number}", xlim=(near, far))
        ax.set(xlabel="range (m)", ylabel="amplitude, of its peak")
    axes[0].legend()
    return save(figure, path)


def pulse(path: Path) -> Path:
    """Draw the transmitted pulse and its spectrum (2.3, 2.5)."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3))
    carrier_hz, sigma_s = _X2.carrier_hz, pulse_sigma_s(_X2.bandwidth_hz)
    t_s = np.linspace(-1e-9, 1e-9, 2001)
    envelope = np.exp(-(t_s**2) / (2 * sigma_s**2))
    left.plot(t_s * 1e9, envelope * np.cos(2 * np.pi * carrier_hz * t_s), lw=0.8)
    left.plot(t_s * 1e9, envelope, "k--", lw=0.8)
    left.set(xlabel="fast time (ns)", ylabel="amplitude", title="pulse")
    f_hz = np.linspace(4e9, 10e9, 600)
    level_db = 20 * np.log10(np.exp(-2 * (np.pi * (f_hz - carrier_hz) * sigma_s) ** 2))
    right.plot(f_hz / 1e9, level_db)
    right.axhline(-10, color="k", ls=":", lw=0.8)
    right.set(xlabel="frequency (GHz)", ylabel="dB", ylim=(-40, 2), title="spectrum")
    return save(figure, path)


def activations(path: Path) -> Path:
    """Draw the activation functions (3.23, 3.25)."""
    figure, axes = plt.subplots(figsize=(4, 3))
    x = torch.linspace(-6, 6, 200)
    for name, function in ACTIVATIONS.items():
        axes.plot(x.numpy(), function()(x).numpy(), label=name)
    axes.set(xlabel="input", ylabel="output", ylim=(-1.2, 2.5))
    axes.legend()
    return save(figure, path)


def bodies(path: Path) -> Path:
    """Draw the scatterer models from above, after they have moved a little (4.1-4.3)."""
    figure, axes = plt.subplots(1, 3, figsize=(9, 3.2), sharey=True)
    for axis, (name, points) in zip(axes, THESIS_BODIES.items(), strict=True):
        position_m, rcs_m2 = ranges_xyz(points, np.array([_MOVED_S]))
        axis.scatter(position_m[0, :, 0], position_m[0, :, 1], s=2 * np.sqrt(rcs_m2), alpha=0.6)
        axis.plot(0, 0, "k^")
        axis.annotate("radar", (0, 0), (0.05, 0.1))
        axis.set(title=name, xlabel="x (m)", xlim=(-0.6, 0.6), ylim=(-0.2, 3.4))
    axes[0].set_ylabel("y (m)")
    return save(figure, path)


def confusions(path: Path, results: list[CellResult]) -> Path:
    """Draw confusion plots in the thesis' layout (table 3.1): rows are what the network says."""
    n_across = 4
    n_down = -(-len(results) // n_across)
    figure, axes = plt.subplots(n_down, n_across, figsize=(12, 3.1 * n_down), squeeze=False)
    for axis in axes.ravel()[len(results) :]:
        axis.axis("off")
    for axis, result in zip(axes.ravel(), results, strict=False):
        _confusion(axis, np.array(result.evaluation.confusion[result.best]))
        axis.set_title(f"{result.name} {result.label}", fontsize=10)
    figure.tight_layout()
    return save(figure, path)


def _confusion(axis: Axes, counts: NDArray[np.int64]) -> None:
    total = int(counts.sum())
    text = {(r, c): f"{n}\n{100 * n / total:.1f} %" for (r, c), n in np.ndenumerate(counts)}
    for k in (0, 1):
        text[k, 2] = _shares(counts[k, k], counts[k].sum())
        text[2, k] = _shares(counts[k, k], counts[:, k].sum())
    text[2, 2] = _shares(np.trace(counts), total)
    cells = np.pad(np.eye(2), (0, 1), constant_values=0.5)
    axis.imshow(cells, cmap="RdYlGn", vmin=-0.6, vmax=1.6)
    for (r, c), words in sorted(text.items()):
        axis.text(c, r, words, ha="center", va="center", fontsize=9)
    axis.set_xticks((0, 1, 2), (*_CLASSES, ""))
    axis.set_yticks((0, 1, 2), (*_CLASSES, ""))
    axis.set(xlabel="target class", ylabel="output class")


def _shares(right: int, of: int) -> str:
    share = 100 * right / max(of, 1)
    return f"{share:.1f} %\n{100 - share:.1f} %" if of else "-"


def confidence(path: Path, result: CellResult) -> Path:
    """Draw the mean probability of the true class over epochs (5.1, 5.2)."""
    values = np.array(result.confidence)
    best = np.array(result.scores)[1:].min(axis=0)
    epochs = np.arange(len(values)) * int(result.settings["fit"]["look_every"])
    figure, axes = plt.subplots(1, 2, figsize=(9, 3), sharey=True)
    pairs = (("good", int(best.argmin())), ("poor", int(best.argmax())))
    for axis, (kind, k) in zip(axes, pairs, strict=True):
        for c, name in enumerate(_CLASSES):
            axis.plot(epochs, values[:, k, c], "o-", label=f"class {c + 1}, {name}")
        title = f"{result.name} {result.label}: {kind} initialisation"
        axis.set(xlabel="epoch of the whole network", title=title, ylim=(0.4, 1))
    axes[0].set_ylabel("confidence")
    axes[0].legend()
    return save(figure, path)


def publish(
    recipe: StudyRecipe, results: Sequence[CellResult], path: Path, commands: tuple[str, str, str]
) -> Path:
    """Write tables of results, and pictures into a folder of the page's name beside it."""
    try:
        pictures = _pictures(recipe, results, path.parent / path.stem)
        path.parent.mkdir(parents=True, exist_ok=True)
        text = page(results, pictures, commands=commands, folder=path.parent)
        write_whole(path, text.encode())
    except OSError as err:
        raise WriteError.of(path, err) from err
    return path


def _pictures(
    recipe: StudyRecipe, results: Sequence[CellResult], folder: Path
) -> dict[str, list[Path]]:
    """Draw all pictures; return their files by heading."""
    pictures: dict[str, list[Path]] = defaultdict(list)
    heading = "Confidence over epochs, a good and a poor initialisation (5.1, 5.2)"
    for label in MAIN:
        if chosen := [r for r in results if r.label == label]:
            path = folder / f"confusion-{label}.png"
            pictures["Confusion (table 3.1, appendix C)"].append(confusions(path, chosen))
            # Of the set whose repeats differ most in score at their best.
            widest = max(chosen, key=lambda r: float(np.ptp(np.min(r.scores[1:], axis=0))))
            path = folder / f"confidence-{label}.png"
            pictures[heading].append(confidence(path, widest))
    pictures["G, µ, D and both vectors (figures 2.5-2.7, 3.7-3.9)"] = [
        five_scatterers(folder / "five-scatterers.png"),
        *(features(folder, recipe.spec(rate_hz), b) for rate_hz in RATES_HZ for b in BODIES),
        profiles(folder / "profiles.png", recipe.spec(60)),
    ]
    pictures["Scatterers from above (figures 4.1-4.3)"] = [bodies(folder / "bodies.png")]
    pictures["Pulse and activation functions"] = [
        pulse(folder / "pulse.png"),
        activations(folder / "activations.png"),
    ]
    return pictures
