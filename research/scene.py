"""A scene as the radar sees it, by eye.

Four pictures over one stretch of time: where power is in range, which velocities it has
(alias-suppressed), the spectrogram, and the way of every body seen from above.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from radard.dsp.doppler import micro_doppler, velocity_mps
from radard.dsp.downconvert import DownConverter
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.velocity import CPI_S, VelocityTransform
from study import check_picture, check_within, run_script, save, script_parser
from x2radar.frame import FastTimeAxis
from x2radar.modules.base import ModuleSettings
from x2radar.modules.modules import MODULES
from x2radar.ports import Port
from x2radar.radars import port_settings
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import Scene, load_scene
from x2radar.sim.scene.stage import Stage

RANGE_DB, VELOCITY_DB = 40.0, 30.0  # shown under the peak: by eye
_OVER_NOISE_DB = 22.0  # columns under it are not stretched: by eye
_COLOURS = {"human": "tab:red", "pet": "tab:blue", "other": "tab:green"}
Map = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ScenePictures:
    """What is drawn, all of it over the same time."""

    range_time: Map  # (n_cells, n_columns): power without clutter
    range_m: Map  # (n_cells,): middles of its cells
    # (n_velocity, n_columns): power; `velocity_mps` is its axis, approaching positive
    velocity_time: Map
    velocity_mps: Map
    spectrogram: Map  # (n_doppler, n_columns): mu
    doppler_mps: Map  # (n_doppler,): its axis
    duration_s: float


def main(argv: Sequence[str] | None = None) -> int:
    """Draw a scene into a file."""
    parser = script_parser(
        "scene",
        "Draw a scene: range, velocity, spectrogram, from above.",
        "human --plot human.png --seed 3",
    )
    add = parser.add_argument
    add("name", help="built-in scene (x2radar scenes) or YAML file")
    add("--plot", type=Path, required=True, metavar="FILE", help="picture to make")
    add("--seed", type=int, default=0, help="same seed, same scene (0)")
    add("--duration", type=float, default=12.0, metavar="S", help="seconds (12)")
    add("--rate", type=float, default=60.0, metavar="HZ", help="frames per second (60)")
    add("--device", default="x2raw", help=f"{', '.join(MODULES)} (x2raw)")
    return run_script(parser, _run, argv)


def _run(args: argparse.Namespace) -> None:
    check_within(args, duration=(2, 3600), seed=(0, 2**31))
    check_picture(args.plot)
    keys = {"device": args.device, "rate": f"{args.rate:g}", "kind": "baseband"}
    settings = port_settings(Port("sim", args.name, keys))
    assert not callable(settings)  # noqa: S101 - only device=auto needs a module
    scene, rate_hz = load_scene(args.name), settings.frame_rate_hz
    frames, axis = scene_frames(scene, args.seed, settings, args.duration)
    shown = pictures(frames, axis, rate_hz)
    figure = Figure(figsize=(12, 7.5), layout="tight")
    axes = figure.subplots(2, 2)
    draw_range_time(axes[0, 0], shown)
    draw_velocity_time(axes[1, 0], shown)
    _draw_velocities(axes[1, 1], shown.spectrogram, shown.doppler_mps, shown.duration_s)
    axes[1, 1].set_title("micro-Doppler spectrogram")
    _draw_above(axes[0, 1], Stage(scene, args.seed, rate_hz), len(frames), axis)
    figure.suptitle(f"{scene.name}, seed {args.seed}: {scene.description}", fontsize=10)
    save(figure, args.plot, 100)


def scene_frames(
    scene: Scene, seed: int, settings: ModuleSettings, duration_s: float
) -> tuple[NDArray[np.complex64], FastTimeAxis]:
    """Return a scene's baseband frames; a lost one repeats the one before."""
    stream = EchoStream(scene, seed, settings)
    rows: list[NDArray[Any]] = []
    for _ in range(round(duration_s * settings.frame_rate_hz)):
        row = stream.next()
        rows += [row] if row is not None else rows[-1:]
    if stream.axis.kind == "baseband":
        return np.stack(rows), stream.axis
    converter = DownConverter(stream.axis)
    return converter.convert(np.stack(rows)), converter.axis


def pictures(
    frames: NDArray[np.complex64], axis: FastTimeAxis, frame_rate_hz: float
) -> ScenePictures:
    """Return the maps of baseband frames, made by the daemon's own code."""
    n_cpi = max(8, round(CPI_S * frame_rate_hz))
    ranges = RangeTimeMap(axis, n_cpi, cell_m=max(0.05, axis.bin_length_m), n_keep=len(frames))
    ranges.push(frames)
    transform = VelocityTransform(axis, frame_rate_hz, n_keep=len(frames))
    transform.push(frames)
    mu = np.asarray(micro_doppler(frames, n_cpi), np.float64)
    return ScenePictures(
        range_time=np.asarray(ranges.columns(), np.float64),
        range_m=ranges.range_m,
        velocity_time=np.asarray(transform.columns(), np.float64),
        velocity_mps=transform.velocity_mps,
        spectrogram=mu,
        doppler_mps=velocity_mps(len(mu), frame_rate_hz, axis.carrier_hz),
        duration_s=len(frames) / frame_rate_hz,
    )


def draw_range_time(axes: Axes, shown: ScenePictures) -> None:
    """Draw the range-time map into `axes`."""
    power = shown.range_time
    top = float(np.quantile(power, 0.9995)) if power.size else 1.0
    _draw_map(axes, power / max(top, 1e-300), shown.range_m, shown.duration_s, RANGE_DB)
    axes.set(xlabel="time (s)", ylabel="range (m)", title="range-time power")


def draw_velocity_time(axes: Axes, shown: ScenePictures) -> None:
    """Draw the velocity-time map into `axes`."""
    _draw_velocities(axes, shown.velocity_time, shown.velocity_mps, shown.duration_s)
    axes.set_title("velocity-time power")


def _draw_velocities(axes: Axes, power: Map, v_mps: Map, duration_s: float) -> None:
    """Draw columns of equal peak, but for those that hold little over the noise."""
    peak = power.max(axis=0, initial=0.0)
    noise = np.median(power.min(axis=0, initial=np.inf)) if power.size else 0.0
    least = max(10 ** (_OVER_NOISE_DB / 10) * noise, 1e-2 * peak.max(initial=1e-300))
    _draw_map(axes, power / np.maximum(peak, least), v_mps, duration_s, VELOCITY_DB)
    axes.set(xlabel="time (s)", ylabel="approaching (m/s)")


def _draw_map(axes: Axes, power: Map, rows: Map, duration_s: float, depth_db: float) -> None:
    level_db = 10 * np.log10(np.maximum(power, 1e-12))
    extent = (0.0, duration_s, float(rows[0]), float(rows[-1]))
    axes.imshow(level_db, aspect="auto", origin="lower", extent=extent, vmin=-depth_db, vmax=0)


def _draw_above(axes: Axes, stage: Stage, n_frames: int, axis: FastTimeAxis) -> None:
    left = n_frames
    named: set[str] = set()
    while left > 0:
        block = stage.next_block(left)
        left -= block.n_slow
        for mover, points in zip(block.movers, block.points, strict=True):
            middle, first = points.position_m.mean(axis=1), points.position_m[0]
            label = mover.label if mover.label not in named else None
            named.add(mover.label)
            colour = _COLOURS[mover.label]
            axes.plot(middle[:, 0], middle[:, 1], color=colour, lw=1.5, label=label)
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


if __name__ == "__main__":
    sys.exit(main())
