"""`train-export scene NAME --plot out.png`: what a scene looks like to the radar, by eye.

Four pictures over one stretch of time: where power is in range, which velocities it has
(alias-suppressed), the spectrogram, and the way of every body seen from above.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from radard.dsp.doppler import micro_doppler, velocity_mps
from radard.dsp.downconvert import DownConverter
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.velocity import CPI_S, VelocityTransform
from x2radar.frame import FastTimeAxis
from x2radar.modules.base import ModuleSettings
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import Scene
from x2radar.sim.scene.stage import Stage

RANGE_DB, VELOCITY_DB = 40.0, 30.0  # shown under the peak: chosen by eye
_OVER_NOISE_DB = 22.0  # columns under it are not stretched: chosen by eye
_COLOURS = {"human": "tab:red", "pet": "tab:blue", "other": "tab:green"}


@dataclass(frozen=True, slots=True, eq=False)
class ScenePictures:
    """What is drawn."""

    axis: FastTimeAxis  # of the baseband frames
    frame_rate_hz: float
    range_time: NDArray[np.float64]  # (n_cells, n_columns): power without clutter
    range_m: NDArray[np.float64]  # (n_cells,): middles of its cells
    # (n_velocity, n_columns): power; `velocity_mps` is its axis, approaching positive
    velocity_time: NDArray[np.float64]
    velocity_mps: NDArray[np.float64]
    spectrogram: NDArray[np.float64]  # (n_doppler, n_columns): mu
    duration_s: float  # of all three


def scene_frames(
    scene: Scene, seed: int, settings: ModuleSettings, duration_s: float
) -> tuple[NDArray[np.complex64], FastTimeAxis]:
    """Return a scene's baseband frames; a lost one repeats the one before."""
    stream = EchoStream(scene, seed, settings)
    frames: list[NDArray[Any] | None] = []
    for _ in range(round(duration_s * settings.frame_rate_hz)):
        frame = stream.next()
        frames.append(frames[-1] if frame is None and frames else frame)
    rows = np.stack([f for f in frames if f is not None])
    if stream.axis.kind == "baseband":
        return rows, stream.axis
    converter = DownConverter(stream.axis)
    return converter.convert(rows), converter.axis


def pictures(
    frames: NDArray[np.complex64], axis: FastTimeAxis, frame_rate_hz: float
) -> ScenePictures:
    """Return the maps of baseband frames, made by the daemon's own code."""
    n_cpi = max(8, round(CPI_S * frame_rate_hz))
    ranges = RangeTimeMap(axis, n_cpi, cell_m=max(0.05, axis.bin_length_m), n_keep=len(frames))
    ranges.push(frames)
    transform = VelocityTransform(axis, frame_rate_hz, n_keep=len(frames))
    transform.push(frames)
    return ScenePictures(
        axis=axis,
        frame_rate_hz=frame_rate_hz,
        range_time=np.asarray(ranges.columns(), np.float64),
        range_m=ranges.range_m,
        velocity_time=np.asarray(transform.columns(), np.float64),
        velocity_mps=transform.velocity_mps,
        spectrogram=np.asarray(micro_doppler(frames, n_cpi), np.float64),
        duration_s=len(frames) / frame_rate_hz,
    )


def plot_scene(
    scene: Scene, seed: int, settings: ModuleSettings, duration_s: float, path: Path
) -> Path:
    """Draw a scene into a file, PNG, PDF or SVG by its suffix; return the file."""
    frames, axis = scene_frames(scene, seed, settings, duration_s)
    shown = pictures(frames, axis, settings.frame_rate_hz)
    figure, axes = plt.subplots(2, 2, figsize=(12, 7.5))
    draw_range_time(axes[0, 0], shown)
    draw_velocity_time(axes[1, 0], shown)
    draw_spectrogram(axes[1, 1], shown)
    stage = Stage(scene, seed, settings.frame_rate_hz)
    _above(axes[0, 1], stage, len(frames), axis)
    figure.suptitle(f"{scene.name}, seed {seed}: {scene.description}", fontsize=10)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path


def draw_range_time(axes: Axes, shown: ScenePictures) -> None:
    """Draw the range-time map into `axes`."""
    extent = (0.0, shown.duration_s, float(shown.range_m[0]), float(shown.range_m[-1]))
    power = shown.range_time
    _image(axes, power, extent, RANGE_DB, float(np.quantile(power, 0.9995)) if power.size else 1.0)
    axes.set(xlabel="time (s)", ylabel="range (m)", title="range-time power")


def draw_velocity_time(axes: Axes, shown: ScenePictures) -> None:
    """Draw the velocity-time map into `axes`."""
    v = shown.velocity_mps
    _image(
        axes,
        _even(shown.velocity_time),
        (0.0, shown.duration_s, float(v[0]), float(v[-1])),
        VELOCITY_DB,
    )
    axes.set(xlabel="time (s)", ylabel="approaching (m/s)", title="velocity-time power")


def draw_spectrogram(axes: Axes, shown: ScenePictures) -> None:
    """Draw the spectrogram into `axes`."""
    v = velocity_mps(len(shown.spectrogram), shown.frame_rate_hz, shown.axis.carrier_hz)
    _image(
        axes,
        _even(shown.spectrogram),
        (0.0, shown.duration_s, float(v[0]), float(v[-1])),
        VELOCITY_DB,
    )
    axes.set(xlabel="time (s)", ylabel="approaching (m/s)", title="micro-Doppler spectrogram")


def _even(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return columns of equal peak, but for those that hold little over the noise."""
    peak = power.max(axis=0, initial=0.0)
    noise = np.median(power.min(axis=0, initial=np.inf)) if power.size else 0.0
    least = max(10 ** (_OVER_NOISE_DB / 10) * noise, 1e-2 * peak.max(initial=1e-300))
    return np.asarray(power / np.maximum(peak, least))


def _image(
    axes: Axes,
    power: NDArray[np.float64],
    extent: tuple[float, float, float, float],
    depth_db: float,
    top: float = 1.0,
) -> None:
    level = 10 * np.log10(np.maximum(power / max(top, 1e-300), 1e-12))
    axes.imshow(level, aspect="auto", origin="lower", extent=extent, vmin=-depth_db, vmax=0)


def _above(axes: Axes, stage: Stage, n_frames: int, axis: FastTimeAxis) -> None:
    left = n_frames
    named: set[str] = set()
    while left > 0:
        block = stage.next_block(left)
        left -= block.n_slow
        for mover, points in zip(block.movers, block.points, strict=True):
            middle = points.position_m.mean(axis=1)
            label = mover.label if mover.label not in named else None
            named.add(mover.label)
            colour = _COLOURS[mover.label]
            axes.plot(middle[:, 0], middle[:, 1], color=colour, lw=1.5, label=label)
            first = points.position_m[0]
            axes.plot(first[:, 0], first[:, 1], ".", color=colour, ms=3)
    angle = np.linspace(0, np.pi, 100)
    for edge_m in axis.range_m[[0, -1]]:
        axes.plot(edge_m * np.cos(angle), edge_m * np.sin(angle), "k:", lw=0.8)
    axes.plot(0, 0, "k^", ms=8)
    reach_m = 1.2 * float(axis.range_m[-1])
    axes.set(
        xlabel="right (m)",
        ylabel="away (m)",
        title="from above; dotted: the swath",
        xlim=(-reach_m, reach_m),
        ylim=(-0.3, reach_m),
    )
    axes.set_aspect("equal")
    if named:
        axes.legend(loc="upper right", fontsize=8)
