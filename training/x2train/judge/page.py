"""Page: the report as one HTML file that needs nothing beside it, and its pictures.

Plots are SVG in the colours of the page around them; pictures of passages are PNG.
"""

import base64
import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from radard.detect.clutter_map import ClutterRemover
from radard.dsp.range_time import RangeTimeMap
from radard.stream.ring import Dwell
from x2train.judge.estimates import Ranking, Reliability
from x2train.judge.figures import Figures, Windows, human_score, is_in_view, is_judged
from x2train.judge.judging import JudgeSpec
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import Outcome, intrusions

_Float = NDArray[np.float64]
_Curve = tuple[str, _Float, _Float]  # its name and points
_Judged = Mapping[str, tuple[PassageTable, Figures]]  # by name: this model, and perhaps another
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
_MIN_SHARE = 1e-3  # left end of the bars
DASH = "\N{EN DASH}"


def page(made: Mapping[str, Any], judged: _Judged, render: Callable[[int], bytes] | None) -> str:
    """Return the page of `made`, the report's JSON; `render` gives PNGs of passages."""
    here, *_ = (figures for _, figures in judged.values())
    plots = {
        "tradeoff": _tradeoff(judged),
        "time": _time_to_alarm(judged),
        "roc": _roc(judged),
        **{name: _diagram(name, found) for name, found in here.content["reliability"].items()},
    }
    worst = [case["index"] for case in made["worst"]]
    pictures = {k: base64.b64encode(render(k)).decode() for k in worst} if render else {}
    environment = Environment(
        loader=PackageLoader("x2train.judge", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "share": share_text,
        "rate": rate_text,
        "figure": figure_text,
        "place": _place,
        "grouped": lambda n: f"{n:,}",
    }
    return environment.get_template("report.html").render(
        report=made,
        plots={name: Markup(svg) for name, svg in plots.items()},  # noqa: S704 - our own SVG
        pictures=pictures,
    )


def share_text(estimate: Mapping[str, float | None]) -> str:
    """Return a share in per cent with its interval: '0.42 % (0.1 to 1.2)'."""
    value, low, high = (estimate[key] for key in ("value", "low", "high"))
    if value is None:
        return DASH
    text = f"{_percent(value)} %"
    if low is not None and high is not None:
        text += f" ({_percent(low)} to {_percent(high)})"
    return text


def rate_text(estimate: Mapping[str, float | None]) -> str:
    """Return a rate per hour with its interval: '0.013 (0.002 to 0.05)', or '< 0.017'."""
    value, low, high = (estimate[key] for key in ("value", "low", "high"))
    if value is None:
        return DASH
    if value == 0:
        return f"< {figure_text(high, 2)}"
    texts = [figure_text(v, 2 if v is None or v < 100 else 3) for v in (value, low, high)]
    return f"{texts[0]} ({texts[1]} to {texts[2]})"


def figure_text(value: float | None, digits: int = 3) -> str:
    """Return a figure, or a dash for what is not known."""
    if value is None:
        return DASH
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def _percent(value: float) -> str:
    # Near one, the distance from it is what matters.
    digits = 1
    for edge in (0.99, 0.999):
        digits += value > edge or value < 1 - edge
    text = f"{100 * value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _place(value: float | None) -> str:
    """Return where a share lies on a bar from 0.1 % to 100 %, logarithmic."""
    least = max(value or 0.0, _MIN_SHARE)
    return f"{100 * (1 - math.log10(least) / math.log10(_MIN_SHARE)):.1f}%"


def _tradeoff(judged: _Judged) -> str:
    here, *others = (figures for _, figures in judged.values())
    sweeps = {"fused": here.sweeps["fused"], "single windows": here.sweeps["window"]}
    for each in others:
        sweeps["other model, fused"] = each.sweeps["fused"]
    shipped: Outcome = here.content["operating_points"][0]["outcome"]
    # What is zero is drawn at half of what could be told from it.
    left = 0.5 / max(shipped.pet_hours, 0.5)
    bottom = 0.5 / max(shipped.n_intrusions, 1)
    curves = []
    for name, sweep in sweeps.items():
        false, missed = sweep.curve()
        x, y = np.maximum(false, left), np.maximum(missed, bottom)
        curves.append((name, np.append(x, max(60.0, 2 * left)), np.append(y, y[-1:])))
    figure, axes = _axes("false alarms per pet-hour", "missed intrusions", curves)
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
    return _svg(figure, "tradeoff", "Missed intrusions against false alarms per pet-hour")


def _roc(judged: _Judged) -> str:
    curves = []
    for name, (table, _) in judged.items():
        windows = Windows.of(table, is_judged(table) & is_in_view(table))
        if windows.is_human.any() and not windows.is_human.all():
            score = human_score(table)[windows.row]
            curves.append((name, *Ranking(score, windows.is_human).rates()))
    lowest = min((x[x > 0].min(initial=1.0) for _, x, _ in curves), default=1.0)
    left = max(float(lowest) / 2, 1e-5)
    seen = [(name, np.maximum(false, left), true) for name, false, true in curves]
    figure, axes = _axes("pet windows called human", "human windows called human", seen)
    chance = np.geomspace(left, 1, 100)
    axes.plot(chance, chance, color=_INK, lw=1, ls=":", label="chance")
    axes.set(xscale="log", xlim=(left, 1), ylim=(0, 1.01))
    return _svg(figure, "roc", "ROC curve of windows")


def _diagram(name: str, found: Reliability) -> str:
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


def _time_to_alarm(judged: _Judged) -> str:
    curves = []
    for name, (table, found) in judged.items():
        alarm_s = found.found[0].alarm_s[intrusions(table)]
        taken_s = np.sort(alarm_s[np.isfinite(alarm_s)])
        share = np.arange(len(taken_s) + 1) / max(len(alarm_s), 1)
        curves.append((name, np.concatenate([[0.0], taken_s, [1e3]]), np.append(share, share[-1])))
    figure, axes = _axes("seconds after entering the swath", "intrusions with an alarm", curves)
    axes.set(xlim=(0, 10), ylim=(0, 1.02))
    return _svg(figure, "time", "Time to alarm")


def _axes(xlabel: str, ylabel: str, curves: Sequence[_Curve] = ()) -> tuple[Figure, Axes]:
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(5.2, 3.9), layout="constrained")
        axes = figure.add_subplot()
        axes.set(xlabel=xlabel, ylabel=ylabel)
    for (name, x, y), colour in zip(curves, _SERIES, strict=False):
        axes.step(x, y, where="post", color=colour, label=name)
    return figure, axes


def _svg(figure: Figure, name: str, title: str) -> str:
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if handles:
        where: Any = {"loc": "outside upper left", "ncols": 2, "frameon": False}
        figure.legend(handles, labels, **where, labelcolor=_INK)
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
