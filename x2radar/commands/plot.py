"""`x2radar plot`: range-time, velocity-time and spectrum of a recording or a port."""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from x2radar.api import read_frames, sent_by
from x2radar.atomic import write_picture
from x2radar.command import StatusLine, legible
from x2radar.commands import Commands, add_command, check_above_zero
from x2radar.errors import SettingsError
from x2radar.extras import needed
from x2radar.frame import SPEED_OF_LIGHT_MPS, Samples, StreamInfo
from x2radar.maps import Map, Reals, range_time, spectrum, velocity_time
from x2radar.ports import is_port

_DEPTHS_DB = (40.0, 30.0)  # under the peak of range and of velocity: what limbs need to show
_SUFFIXES = (".png", ".pdf", ".svg")


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "plot",
        "draw a recording, or what a port sends",
        "examples:\n  x2radar plot dog.h5 --out dog.png\n  x2radar plot sim:dog --duration 10\n",
    )
    add = parser.add_argument
    add("what", metavar="FILE|PORT", help="recording, device, URL or sim:SCENE")
    add("--out", type=Path, metavar="FILE", help="PNG, PDF or SVG to make; a window without")
    add("--start", type=float, default=0.0, metavar="S", help="of a recording: begin here (0)")
    add("--duration", type=float, default=20.0, metavar="S", help="seconds to draw (20)")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_above_zero("--duration", args.duration, "seconds")
    if args.out is not None and args.out.suffix not in _SUFFIXES:
        raise SettingsError(f"--out {args.out}: must end in {', '.join(_SUFFIXES)}")
    needed("matplotlib", what="pictures")
    if is_port(args.what):
        title, start_s = args.what, 0.0
        status = StatusLine(sys.stderr)
        samples, stream = sent_by(
            title, args.duration, lambda k, n: status.show(f"{title}: {k} of {n} frames")
        )
        status.clear()
    else:
        path, start_s = Path(args.what.removeprefix("replay:")), args.start
        title = path.name
        samples, stream = read_frames(path, start_s=start_s, duration_s=args.duration)
    plt: Any = needed("matplotlib.pyplot", what="pictures")
    if args.out is None and plt.get_backend().lower() == "agg":
        raise SettingsError("no window can be opened here; give --out FILE.png")
    figure = draw(title, stream, samples, start_s)
    if args.out is None:
        plt.show()
        return 0
    write_picture(args.out, figure)
    print(args.out, file=sys.stderr)
    return 0


def filled(samples: Samples) -> tuple[Samples, int]:
    """Return frames whose missing ones, NaN, repeat the one before, and how many those are."""
    is_here = np.isfinite(samples).all(axis=1)
    last = np.maximum.accumulate(np.where(is_here, np.arange(len(samples)), 0))
    whole: Any = np.nan_to_num(samples[last])
    return whole, int(np.count_nonzero(~is_here))


def draw(title: str, stream: StreamInfo, samples: Samples, start_s: float) -> Any:
    """Return a matplotlib figure of three pictures of frames (n, n_range), NaN where missing."""
    plt: Any = needed("matplotlib.pyplot", what="pictures")
    axis, rate_hz = stream.axis, stream.frame_rate_hz
    samples, n_lost = filled(samples)
    ranges = range_time(samples, axis, rate_hz)
    velocities = velocity_time(samples, axis, rate_hz)
    total, moving, frequency_hz = spectrum(samples, axis)
    figure, (top, middle, bottom) = plt.subplots(3, 1, figsize=(9, 10), layout="constrained")
    lost = f", {n_lost} frames missing" if n_lost else ""
    length = f"{len(samples) / rate_hz:.1f} s at {rate_hz:g} Hz{lost}"
    figure.suptitle(f"{legible(title)}: {length}", parse_math=False)
    for axes, shown, depth_db in zip((top, middle), (ranges, velocities), _DEPTHS_DB, strict=True):
        image = _image(axes, shown, start_s, depth_db)
        figure.colorbar(image, ax=axes, label="power under the peak (dB)", pad=0.01)
    top.set(ylabel="range (m)", title="what moves, by range", xlabel="time (s)")
    # Where the phase turns by half a circle from frame to frame, c fp / (4 fc).
    alias_mps = SPEED_OF_LIGHT_MPS * rate_hz / (4 * axis.carrier_hz)
    if alias_mps < velocities[1][-1]:
        for sign in (-1, 1):
            middle.axhline(sign * alias_mps, color="white", ls="--", lw=0.8)
        text = f"beyond ±{alias_mps:.2f} m/s (dashed) bands may be aliases, "
        text += f"{2 * alias_mps:.2f} m/s off"
    else:
        text = "no aliases"
    middle.set(ylabel="radial velocity (m/s),\napproaching positive", xlabel="time (s)")
    middle.set_title(f"by radial velocity: {text}")
    for values, name in ((total, "all"), (moving, "what moves")):
        # Without the mean of the RF samples, which is not of the pulse and above all else.
        bottom.plot(frequency_hz[1:] / 1e9, _db(values)[1:], label=name, lw=1)
    bottom.set(xlabel="frequency (GHz)", ylabel="power (dB, sample units²)")
    bottom.set_title("spectrum of the frames")
    bottom.legend(loc="upper right")
    return figure


def _image(axes: Any, shown: Map, start_s: float, depth_db: float) -> Any:
    power, rows, t_s = shown
    times_s, extent = t_s + start_s, []
    for values in (times_s, rows):
        half = (values[-1] - values[0]) / max(1, len(values) - 1) / 2 or 0.5
        extent += [values[0] - half, values[-1] + half]
    level_db = _db(power)
    how = {"aspect": "auto", "origin": "lower", "extent": extent}
    return axes.imshow(level_db - level_db.max(), vmin=-depth_db, vmax=0, **how)


def _db(power: Reals) -> Reals:
    return np.asarray(10 * np.log10(np.maximum(power, np.finfo(np.float64).tiny)))
