"""Page: the report as one HTML file that needs nothing beside it."""

import base64
import math
from collections.abc import Callable, Mapping
from importlib import resources
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from x2train.judge.estimates import Ranking
from x2train.judge.figures import Figures
from x2train.judge.plots import Curve, diagram, roc, time_to_alarm, tradeoff
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import intrusions
from x2train.judge.windows import Windows, human_score, is_in_view, is_judged

_BY = {
    "split": "By split",
    "family": "By family",
    "suite": "By suite",
    "build": "By body",
    "speed_mps": "By speed, m/s",
    "range_m": "By range, m",
    "aspect_deg": "By aspect, degrees",
    "snr_db": "By SNR, dB",
}
_MIN_SHARE = 1e-3  # left end of the bars
DASH = "\N{EN DASH}"
Render = Callable[[int], bytes | None]


def page(
    made: Mapping[str, Any],
    table: PassageTable,
    here: Figures,
    there: tuple[PassageTable, Figures] | None,
    render: Render | None,
) -> str:
    """Return the page of `made`, the report's JSON; `render` gives PNGs of passages, or None."""
    both = [("this model", table, here)]
    if there is not None:
        both.append(("other model", *there))
    windows = [_window_curve(name, t) for name, t, _ in both]
    plots = {
        "tradeoff": tradeoff(here, None if there is None else there[1]),
        "time": time_to_alarm([_time_curve(name, t, f) for name, t, f in both]),
        "roc": roc([curve for curve in windows if curve is not None]),
        **{name: diagram(name, found) for name, found in here.reliability.items()},
    }
    pictures = {}
    for index in (case["index"] for case in here.worst):
        png = None if render is None else render(index)
        if png is not None:
            pictures[index] = "data:image/png;base64," + base64.b64encode(png).decode()
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "share": share_text,
        "rate": rate_text,
        "figure": figure_text,
        "bar": _bar,
        "grouped": lambda n: f"{n:,}",
    }
    text = resources.files("x2train.judge").joinpath("report.html").read_text(encoding="utf-8")
    return environment.from_string(text).render(
        report=made,
        plots={name: Markup(svg) for name, svg in plots.items()},  # noqa: S704 - our own SVG
        pictures=pictures,
        by=_BY,
        tiles=_tiles(made),
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


def _bar(estimate: Mapping[str, float | None]) -> Markup:
    """Return a share and its interval as a bar, from 0.1 % to 100 %, logarithmic."""
    if estimate["value"] is None:
        return Markup()

    def place(value: float | None) -> float:
        least = max(value or 0.0, _MIN_SHARE)
        return 100 * (1 - math.log10(least) / math.log10(_MIN_SHARE))

    low, value, high = (place(estimate[key]) for key in ("low", "value", "high"))
    style = f"--low:{low:.1f}%;--value:{value:.1f}%;--high:{high:.1f}%"
    return Markup('<span class="bar" aria-hidden="true" style="{}"><i></i><b></b></span>').format(
        style
    )


def _tiles(made: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return the headline: what, the figure, and what it rests on."""
    shipped = made["operating_points"][0]["outcome"]
    budget = next(p for p in made["operating_points"] if p["budget_h"] == 60)
    windows = made["windows"]
    required = [b for b in made["baselines"] if b["is_required"] and b["auc"]["value"] is not None]
    worst = max(required, key=lambda b: b["auc"]["value"], default=None)
    median, p90 = shipped["median_s"]["value"], shipped["p90_s"]["value"]
    note = "" if budget["is_resolved"] else "; too few pet-hours to tell it from none at all"
    return [
        (
            "intrusions missed",
            share_text(shipped["miss_rate"]),
            f"{shipped['n_missed']:,} of {shipped['n_intrusions']:,}, as shipped",
        ),
        (
            "false alarms per pet-hour",
            rate_text(shipped["false_alarms_per_hour"]),
            f"{shipped['n_false_alarms']:,} in {figure_text(shipped['pet_hours'])} h, "
            f"{figure_text(made['pet_hours_in_swath'])} h of them in the swath; as shipped",
        ),
        (
            "missed at one false alarm in 60 pet-hours",
            share_text(budget["outcome"]["miss_rate"]),
            f"limit {figure_text(budget['pet_limit'])}{note}",
        ),
        (
            "median time to alarm",
            DASH if median is None else f"{figure_text(median, 2)} s",
            "fewer than nine of ten at all"
            if p90 is None
            else f"nine of ten within {figure_text(p90, 2)} s",
        ),
        (
            "AUC of windows",
            figure_text(windows["auc"]["value"], 4),
            f"balanced accuracy {share_text(windows['balanced_accuracy'])}",
        ),
        (
            "single features",
            "below 0.60" if made["is_matched"] else "NOT below 0.60",
            "not known"
            if worst is None
            else f"most: {worst['name']}, {worst['auc']['value']:.2f}",
        ),
    ]


def _window_curve(name: str, table: PassageTable) -> Curve | None:
    windows = Windows.of(table, is_judged(table) & is_in_view(table))
    if windows.is_human.all() or not windows.is_human.any():
        return None
    _, false, true = Ranking(human_score(table)[windows.row], windows.is_human).rates()
    return Curve(name, false, true)


def _time_curve(name: str, table: PassageTable, found: Figures) -> Curve:
    taken_s = np.sort(found.found[0].alarm_s[intrusions(table)])
    n = max(len(taken_s), 1)
    taken_s = taken_s[np.isfinite(taken_s)]
    reached = np.arange(1, len(taken_s) + 1) / n
    last = reached[-1] if len(reached) else 0.0
    return Curve(
        name, np.concatenate([[0.0], taken_s, [1e3]]), np.concatenate([[0.0], reached, [last]])
    )
