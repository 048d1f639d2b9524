"""`radard why`: one moment of a recording explained, as lines and as a picture."""

import sys
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from radard.config.options import JUDGING, add_options, check_limits, judging_config
from radard.errors import UsageError
from radard.judge.bundle import PROBABILITIES
from radard.judge.occlusion import MapView, Part, effects, map_views, occluded
from radard.run.replays import Moment, moment_of
from x2radar.atomic import write_picture
from x2radar.command import Parser, legible, new_parser
from x2radar.extras import needed

_ABOUT = "Say why a recording was judged as it was at one moment, and what moved the verdict."
_EXAMPLES = """\
examples:
  radard why night.h5 --at 3605.5                    in words
  radard why night.h5 --at 3605.5 --out why.png      and as a picture
The picture needs the extra plot. Red parts of a map spoke for a person.
"""
_SUFFIXES = (".png", ".pdf", ".svg")
_MAX_PARTS, _MAX_WINDOWS = 6, 8  # the strongest and the last ones: a screen of them
_MIN_EFFECT = 0.1  # Nats: a part below it moves a probability of one half by 0.025


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    out: Path | None = args.out
    if out is not None:
        if out.suffix not in _SUFFIXES:
            raise UsageError(f"--out {out}: must end in {', '.join(_SUFFIXES)}")
        needed("matplotlib", what="pictures")
    check_limits(args, at=(0, 1e9))
    moment = moment_of(args.file, args.at, judging_config(args, args.file))
    parts = []
    limit = moment.hello["pet_limit"]
    if moment.classifier is not None and moment.seen is not None:
        parts = occluded(moment.classifier, moment.settings, moment.seen, limit)
    print("\n".join(lines(moment, parts)))
    if out is not None:
        write_picture(out, figure(moment, parts))
        print(out, file=sys.stderr)
    return 0


def make_parser() -> Parser:
    parser = new_parser("radard why", _ABOUT, _EXAMPLES)
    add = parser.add_argument
    add("file", type=Path, metavar="FILE", help="recording, or folder of its parts")
    add("--at", type=float, required=True, metavar="S", help="seconds of the recording")
    add("--out", type=Path, metavar="FILE", help="PNG, PDF or SVG to draw")
    add_options(parser, *JUDGING)
    return parser


def lines(moment: Moment, parts: Sequence[Part]) -> Iterator[str]:
    """Yield what `radard why` prints."""
    told, record = moment.told, moment.record
    yield f"{moment.path}, window that ends at {record['t_s']:.2f} s: {told['headline']}"
    yield ""
    for stage in told["stages"]:
        mark = "*" if stage["name"] == told["decided_by"] else " "
        body = textwrap.wrap(stage["text"], 70)
        yield f"{mark} {stage['name']:<14}{body[0]}"
        yield from (f"{'':<16}{line}" for line in body[1:])
    yield "  * decided"
    yield ""
    if moment.seen is None:
        yield "No network was asked, so there are no maps to look into."
        return
    yield "window by window: this window alone, and fused with those before it"
    yield f"  {'t_s':>7} {'human':>7} {'pet':>7} {'other':>7}   {'human':>7} {'pet':>7}  label"
    for r in moment.records[-_MAX_WINDOWS:]:
        own, both = (
            " ".join(f"{'-':>7}" if r[key] is None else f"{r[key]:7.3f}" for key in keys)
            for keys in (PROBABILITIES[:3], PROBABILITIES[3:5])
        )
        yield f"  {r['t_s']:7.2f} {own}   {both}  {r['label']}"
    yield ""
    yield from _told_parts(moment, parts)


def _told_parts(moment: Moment, parts: Sequence[Part]) -> Iterator[str]:
    shown = [part for part in parts if abs(part.effect) >= _MIN_EFFECT][:_MAX_PARTS]
    if not shown:
        yield "no part of the maps moved p(human) alone"
        return
    p_human = moment.record["fused_p_human"]
    yield f"what moved p(human), {p_human:.3f} here; without this part it would be"
    for part in shown:
        side = "for a person" if part.effect > 0 else "against"
        turn = "; the verdict turns" if part.turns else ""
        yield f"  {part.p_human:6.3f}  {place(part)}: {side}{turn}"
    if not any(part.turns for part in parts):
        yield "  no part alone turns the verdict"


def place(part: Part) -> str:
    """Return where a part lies, in the units of its map."""
    view = part.view
    rows, columns = view.rows[part.rows], view.columns[part.columns]
    sides = (rows, view.row_unit), (columns, view.column_unit)
    spans = ", ".join(f"{side[0]:.4g} to {side[-1]:.4g} {unit}" for side, unit in sides if unit)
    return f"{view.name}, " + spans.replace("-", "\N{MINUS SIGN}")


def figure(moment: Moment, parts: Sequence[Part]) -> Any:
    """Return a matplotlib figure: maps, what their parts stood for, and evidence over time."""
    plt: Any = needed("matplotlib.pyplot", what="pictures")
    seen, views = moment.seen, []
    if seen is not None:
        views = [(v, v.of(seen.features[v.feature])) for v in map_views(moment.settings, seen)]
    n = max(1, len(views))
    fig = plt.figure(figsize=(3.4 * n + 1, 9), layout="constrained")
    name, t_s = legible(moment.path.name), moment.record["t_s"]
    fig.suptitle(f"{name}, {t_s:.2f} s: {moment.told['headline']}", parse_math=False)
    grid = fig.add_gridspec(3, n, height_ratios=(3, 3, 2))
    most = max((abs(part.effect) for part in parts), default=0.0) or 1.0
    for k, (view, values) in enumerate(views):
        shown = fig.add_subplot(grid[0, k])
        _image(shown, values, view, cmap="magma")
        shown.set_title(view.name, fontsize=9)
        moved = fig.add_subplot(grid[1, k])
        image = _image(moved, effects(parts, view), view, cmap="RdBu_r", vmin=-most, vmax=most)
        moved.set_title("red speaks for a person", fontsize=8)
        if k == n - 1:
            fig.colorbar(image, ax=moved, label="log-odds of a person (nats)")
    _evidence(fig.add_subplot(grid[2, :]), moment)
    return fig


def _image(axes: Any, values: Any, view: MapView, **look: Any) -> Any:
    extent: list[float] = []
    for axis in (view.columns, view.rows):
        half = (axis[-1] - axis[0]) / max(1, len(axis) - 1) / 2 or 0.5
        extent += [axis[0] - half, axis[-1] + half]
    axes.set_xlabel(view.column_unit, fontsize=8)
    axes.set_ylabel(view.row_unit, fontsize=8)
    return axes.imshow(values, aspect="auto", origin="lower", extent=extent, **look)


def _evidence(axes: Any, moment: Moment) -> None:
    open_ones = [r for r in moment.records if r["p_human"] is not None]
    t_s = [r["t_s"] for r in open_ones]
    for key, colour in (("human", "tab:red"), ("pet", "tab:blue"), ("other", "tab:gray")):
        axes.plot(t_s, [r[f"p_{key}"] for r in open_ones], ":", color=colour)
        fused = [r[f"fused_p_{key}"] for r in open_ones]
        axes.plot(t_s, fused, "o-", ms=3, color=colour, label=key)
    harmless = [r["fused_p_pet"] + r["fused_p_other"] for r in open_ones]
    axes.plot(t_s, harmless, "--", color="k", lw=0.8, label="pet + other")
    axes.axhline(moment.hello["pet_limit"], color="k", lw=0.5)
    axes.set(xlabel="time (s)", ylabel="probability", ylim=(-0.02, 1.02))
    axes.set_title("evidence; dotted: each window alone; line: no alarm above it", fontsize=8)
    if t_s:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
