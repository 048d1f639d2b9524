"""Plots of the report, SVG in the colours of the page around it, and pictures of passages."""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

mpl.use("Agg")

from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from radard.detect.clutter_map import ClutterRemover
from radard.dsp.range_time import RangeTimeMap
from radard.stream.ring import Dwell
from x2train.judge.estimates import Reliability
from x2train.judge.figures import Figures
from x2train.judge.judging import JudgeSpec

_Float = NDArray[np.float64]
_INK, _FAINT = "#010203", "#010204"
_SERIES = ("#010205", "#010206", "#010207")
# Colours that stand for the page's own, so that the same picture suits light and dark.
_CSS = {
    _INK: "currentColor",
    _FAINT: "var(--faint)",
    **{colour: f"var(--series-{k + 1})" for k, colour in enumerate(_SERIES)},
}
_STYLE: Any = {
    "svg.fonttype": "none",
    "axes.edgecolor": _FAINT,
    "axes.labelcolor": _INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": _FAINT,
    "grid.linewidth": 0.5,
    "grid.alpha": 0.5,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "xtick.minor.size": 0,
    "ytick.minor.size": 0,
    "text.color": _INK,
    "font.size": 11,
    "legend.frameon": False,
    "lines.linewidth": 2,
}
_CELL_S = 0.1  # of a passage: a pixel or two of its picture


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A line of a plot: its name and points."""

    name: str
    x: _Float
    y: _Float


def tradeoff(here: Figures, there: Figures | None) -> str:
    """Return misses against false alarms per pet-hour, of every limit."""
    sweeps = {"fused": here.sweeps["fused"], "single windows": here.sweeps["window"]}
    if there is not None:
        sweeps["other model, fused"] = there.sweeps["fused"]
    shipped = here.shipped
    # What is zero is drawn at half of what could be told from it.
    left = 0.5 / max(shipped.pet_hours, 0.5)
    bottom = 0.5 / max(shipped.n_intrusions, 1)
    figure, axes = _axes("false alarms per pet-hour", "missed intrusions")
    for k, (name, sweep) in enumerate(sweeps.items()):
        false, missed = sweep.curve()
        x, y = np.maximum(false, left), np.maximum(missed, bottom)
        x, y = _thinned(np.append(x, max(60.0, 2 * left)), np.append(y, y[-1:]), is_log=True)
        axes.step(x, y, where="post", color=_SERIES[k], label=name)
    rate, miss = shipped.false_alarms_per_hour, shipped.miss_rate
    if np.isfinite([rate.value, miss.value]).all():
        x0, y0 = max(rate.value, left), max(miss.value, bottom)
        axes.errorbar(
            x0,
            y0,
            xerr=[[x0 - max(rate.low, left)], [max(rate.high, x0) - x0]],
            yerr=[[y0 - max(miss.low, bottom)], [max(miss.high, y0) - y0]],
            fmt="o",
            color=_INK,
            label="as shipped",
            zorder=5,
        )
    axes.axvline(1 / 60, color=_INK, lw=1, ls=":")
    axes.set(xscale="log", yscale="log", xlim=(left, max(60.0, 2 * left)), ylim=(bottom, 1))
    _legend(axes)
    return _svg(figure, "tradeoff", "Missed intrusions against false alarms per pet-hour")


def roc(curves: Sequence[Curve]) -> str:
    """Return the ROC curve of windows: people called human against pets called human."""
    figure, axes = _axes("pet windows called human", "human windows called human")
    lowest = min((curve.x[curve.x > 0].min(initial=1.0) for curve in curves), default=1.0)
    left = max(float(lowest) / 2, 1e-5)
    for k, curve in enumerate(curves):
        x, y = _thinned(np.maximum(curve.x, left), curve.y, is_log=True)
        axes.step(x, y, where="post", color=_SERIES[k], label=curve.name)
    chance = np.geomspace(left, 1, 100)
    axes.plot(chance, chance, color=_INK, lw=1, ls=":", label="chance")
    axes.set(xscale="log", xlim=(left, 1), ylim=(0, 1.01))
    _legend(axes)
    return _svg(figure, "roc", "ROC curve of windows")


def diagram(name: str, found: Reliability) -> str:
    """Return a reliability diagram: observed frequency per bin of predicted probability."""
    figure, axes = _axes("predicted probability of a person", "observed frequency")
    axes.plot([0, 1], [0, 1], color=_INK, lw=1, ls=":")
    bins = [b for b in found.bins if b.n]
    p = np.array([b.mean_p for b in bins])
    share = np.array([[b.share.value, b.share.low, b.share.high] for b in bins]).reshape(-1, 3)
    share[np.isnan(share[:, 1]), 1:] = 0.0, 1.0
    error = np.abs(share[:, 1:] - share[:, :1]).T
    axes.errorbar(p, share[:, 0], yerr=error, fmt="o-", color=_SERIES[0], elinewidth=1)
    most = max((b.n for b in bins), default=1)
    heights = [0.25 * np.log1p(b.n) / np.log1p(most) for b in found.bins]
    axes.bar(
        (np.arange(len(heights)) + 0.5) / len(heights),
        heights,
        width=0.9 / len(heights),
        color=_FAINT,
        alpha=0.6,
        zorder=0,
    )
    axes.set(xlim=(0, 1), ylim=(0, 1.02))
    return _svg(figure, f"reliability-{name}", f"Reliability diagram, {name}")


def time_to_alarm(curves: Sequence[Curve]) -> str:
    """Return the share of intrusions with an alarm by each second after entering."""
    figure, axes = _axes("seconds after entering the swath", "intrusions with an alarm")
    for k, curve in enumerate(curves):
        x, y = _thinned(curve.x, curve.y)
        axes.step(x, y, where="post", color=_SERIES[k], label=curve.name)
    axes.set(xlim=(0, 10), ylim=(0, 1.02))
    _legend(axes)
    return _svg(figure, "time", "Time to alarm")


def _axes(xlabel: str, ylabel: str) -> tuple[Figure, Axes]:
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(5.2, 3.9), layout="constrained")
        FigureCanvasSVG(figure)
        axes = figure.add_subplot()
        axes.set(xlabel=xlabel, ylabel=ylabel)
        return figure, axes


def _legend(axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        axes.figure.legend(
            handles, labels, loc="outside upper left", ncols=2, frameon=False, labelcolor=_INK
        )


def _thinned(x: _Float, y: _Float, *, is_log: bool = False) -> tuple[_Float, _Float]:
    """Leave out points that would be drawn on the one before."""
    if len(x) < 3:
        return x, y
    at = np.stack([np.log10(x) if is_log else x, y])
    span = np.ptp(at, axis=1, keepdims=True)
    cell = np.round(600 * (at - at.min(axis=1, keepdims=True)) / np.where(span > 0, span, 1))
    keep = np.append(True, np.any(np.diff(cell, axis=1) != 0, axis=0))
    keep[-1] = True
    return x[keep], y[keep]


def _svg(figure: Figure, name: str, title: str) -> str:
    """Return the figure as an element of a page."""
    file = io.StringIO()
    # The salt names clip paths: pictures of one page must not share them by accident.
    with mpl.rc_context({**_STYLE, "svg.hashsalt": name}):
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    text = file.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r"font: ([\d.]+)px [^;\"]+", r"font: \1px system-ui, sans-serif", text)
    text = re.sub(r"<svg ([^>]*?)width=\"[^\"]*\" height=\"[^\"]*\"", r"<svg \1", text, count=1)
    text = re.sub(r"(id=\"|url\(#|href=\"#)", rf"\g<1>{name}-", text)
    for colour, css in _CSS.items():
        text = text.replace(colour, css)
    return text.replace("<svg ", f'<svg role="img" aria-label="{title}" ', 1)


def passage_png(spec: JudgeSpec, number: int) -> bytes:
    """Return a small PNG of passage `number`: residual power by range and time."""
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
