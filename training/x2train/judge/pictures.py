"""Pictures of passages: what the radar saw, as range over time, with the true path."""

import io

import matplotlib as mpl
import numpy as np

from radard.detect.clutter_map import ClutterRemover
from radard.dsp.range_time import RangeTimeMap
from radard.stream.ring import Dwell
from x2train.judge.judging import JudgeSpec

_CELL_S = 0.1  # chosen: a pixel or two of the picture


def passage_png(spec: JudgeSpec, number: int) -> bytes:
    """Return a small PNG of passage `number`: residual power by range and time."""
    mpl.use("Agg")
    # Late: only reports need it.
    from matplotlib.figure import Figure  # noqa: PLC0415

    played = spec.played(number)
    radar = played.site.radar
    axis, rate_hz = radar.axis(), radar.frame_rate_hz
    n = len(played.frames)
    dwell = Dwell(played.frames, np.ones(n, bool), axis, rate_hz, n / rate_hz)
    clean = ClutterRemover().remove(dwell).frames
    ranges = RangeTimeMap(
        axis,
        max(4, round(28 / 60 * rate_hz)),
        cell_m=0.05,
        near_m=radar.near_m,
        far_m=radar.far_m,
        n_keep=n,
    )
    ranges.push(clean)
    power, _ = ranges.cells(rate_hz, cell_s=_CELL_S, n_cells=int(n / rate_hz / _CELL_S))
    level_db = 10 * np.log10(np.maximum(power, 1e-30))
    top = float(level_db.max())
    figure = Figure(figsize=(4.2, 2.2), dpi=90, layout="constrained")
    axes = figure.add_subplot()
    axes.imshow(
        level_db,
        origin="lower",
        aspect="auto",
        extent=(0, n / rate_hz, radar.near_m, radar.far_m),
        vmin=top - 40,
        vmax=top,
        cmap="magma",
    )
    t_s = np.arange(n) / rate_hz
    for k in range(played.truth.range_m.shape[1]):
        seen = np.where(played.truth.snr_db[:, k] > 0, played.truth.range_m[:, k], np.nan)
        axes.plot(t_s, seen, color="white", lw=0.8, ls=":")
    axes.set_xlabel("time, s")
    axes.set_ylabel("range, m")
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()
