"""What speed costs in accuracy, switch by switch, bundle by bundle: `docs/tradeoff.md`.

Settings of an installation are in the same page, by `levers.py`.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from radard.judge.bundle import load_bundle
from study import (
    Marks,
    check_picture,
    check_within,
    processor,
    publish,
    run_script,
    save,
    say,
    script_parser,
)
from tradeoff_measure import (
    SETTINGS,
    SWITCHES,
    Combination,
    SwitchRow,
    best,
    check_combined,
    combinations,
    judged_windows,
    map_ms,
    measure,
    record,
)
from x2train.commands import counted

MARKS: Marks = ("<!-- switches -->", "<!-- end of switches -->")
_PICTURES = {
    "velocity_time": "velocity-time",
    "velocity_time_medium": "medium CPI",
    "velocity_time_long": "long CPI",
    "range_time": "range-time",
}
_SHORT = "--scenes human --draws 1 --duration 6 --rounds 1 --passages 12"
_MIN_LOSS_DB = 1e-3  # drawn for none
_MARKS = {3: "o", 2: "s", 1: "^"}  # of combinations, by their CPIs
_RING: Any = {"marker": "o", "ms": 10, "mfc": "none", "mec": "k", "ls": "none"}
_NEARBY = ((4, -10), (6, 4), (-7, -3), (6, -10), (-7, 3))
"""Where a switch's values stand beside their points, in points: switches share some points."""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure switches and combinations; print the tables."""
    parser = script_parser(
        "tradeoff",
        "Measure what every switch costs and loses; print the tables.",
        "--combine fast balanced accurate\n"
        "--scenes human --draws 1 --duration 6 --rounds 1 --plot small.png",
    )
    add = parser.add_argument
    add("--scenes", nargs="+", default=["human", "dog", "fan"], metavar="SCENE", help="built-in")
    add("--draws", type=int, default=2, help="seeds of every scene (2)")
    add("--seed", type=int, default=0, help="the first of them (0)")
    add("--duration", type=float, default=14.0, metavar="S", help="seconds of each (14)")
    add("--rate", type=float, default=60.0, metavar="HZ", help="frames per second (60)")
    add("--rounds", type=int, default=5, help="how often everything is timed (5)")
    add(
        "--combine",
        nargs="+",
        default=[],
        metavar="NAME",
        help="bundles to judge with every combination of maps and decimation",
    )
    add("--passages", type=int, default=400, help="passages that they are judged by (400)")
    add("--page", type=Path, metavar="FILE", help="a page whose tables of switches are replaced")
    add("--plot", type=Path, metavar="FILE", help="PNG")
    return run_script(parser, _run, argv)


def _run(args: argparse.Namespace) -> None:
    check_within(
        args,
        draws=(1, 100),
        rounds=(1, 100),
        rate=(20, 400),
        passages=(12, 100_000),
        duration=(5, 600),
        seed=(0, 2**31),
    )
    check_picture(args.plot)
    bundles = [load_bundle(name) for name in args.combine]
    for bundle in bundles:
        check_combined(bundle)
    seeds = range(args.seed, args.seed + args.draws)
    recordings = [record(s, args.rate, args.duration, k) for s in args.scenes for k in seeds]
    made: list[Combination] = []
    grid: list[str] = []
    if bundles:
        with counted("passages") as tell:
            windows = judged_windows(args.passages, args.seed, bundles, tell)
        with counted("timing") as tell:
            costs_ms = map_ms(recordings, SETTINGS, args.rounds, tell)
        made = combinations(bundles, windows, costs_ms, args.seed)
        grid = grid_section(made, len(windows.passage), int(windows.passage.max()) + 1)
    with counted("switches") as tell:
        rows = measure(recordings, args.rounds, tell)
    lines = [_how(args), "", *table(rows), "", *grid]
    say("\n".join(lines))
    if args.page:
        publish(args.page, MARKS, lines, _command(args), _SHORT)
    if args.plot:
        save(drawn(rows, made), args.plot, 110)


def _how(args: argparse.Namespace) -> str:
    scenes = ", ".join(args.scenes)
    draws = f"{args.draws} draws of {args.duration:g} s each, X2 at {args.rate:g} Hz"
    return f"Scenes {scenes} ({draws}), one thread of {processor()}."


def _command(args: argparse.Namespace) -> str:
    parts = ["python research/tradeoff.py"]
    if args.combine:
        parts.append(f"--combine {' '.join(args.combine)} --passages {args.passages}")
    return " ".join(parts)


def table(rows: Sequence[SwitchRow]) -> Iterator[str]:
    """Yield the lines of the table of switches; what the shipped bundles have is bold."""
    titles = {switch.name: switch.title for switch in SWITCHES}
    heads = " | ".join(f"loss {name}, dB" for name in _PICTURES.values())
    yield f"| switch | value | ms | ratio | {heads} |"
    yield "|---|---|---|---|" + "---|" * len(_PICTURES)
    for row in rows:
        value = f"**{row.value}**" if row.is_default else f"{row.value}"
        losses = " | ".join(
            f"{row.loss_db[name]:.2g}" if name in row.loss_db else "not made" for name in _PICTURES
        )
        cost = f"{row.ms_per_hop:.2f} | {row.ratio:.2f}"
        yield f"| {titles[row.switch]} | {value} | {cost} | {losses} |"


def grid_section(made: Sequence[Combination], n_windows: int, n_passages: int) -> list[str]:
    """Return a table of combinations and what it means, as lines of Markdown."""
    models = tuple(dict.fromkeys(c.model for c in made))
    found = {(c.model, c.setting): c for c in made}
    widest = max(c.auc.high - c.auc.low for c in made) / 2
    lines = [
        f"Window AUC, people against pets, over {n_windows} windows of {n_passages} simulated",
        "passages before an X2 with all its bins. *Range*: how many bins become one; *CPIs*: how",
        "many velocity-time maps the network is shown, the others are blank. **ms** is without",
        "network, whose own are in the second row. **Bold** is as shipped, a star that nothing",
        f"else is both cheaper and better. 95 % intervals reach {widest:.3f} to either side at",
        "most, less for differences. No network was retrained.",
        "",
        f"| range | CPIs | ms | {' | '.join(models)} |",
        "|---|---|---|" + "---|" * len(models),
        "| | | network, ms: | "
        + " | ".join(f"{found[m, SETTINGS[0]].network_ms:.2f}" for m in models)
        + " |",
    ]
    front = best(made)
    for setting in SETTINGS:
        row = [found[model, setting] for model in models]
        told = [f"**{c.auc.value:.3f}**" if c.is_shipped else f"{c.auc.value:.3f}" for c in row]
        cells = [f"{t} *" if c in front else t for t, c in zip(told, row, strict=True)]
        ms = f"{row[0].map_ms:.2f}"
        lines.append(f"| {setting.decimation} | {setting.cpis} | {ms} | {' | '.join(cells)} |")
    return lines


def drawn(rows: Sequence[SwitchRow], combined: Sequence[Combination]) -> Figure:
    """Draw loss against cost, picture by picture, and AUC against cost of combinations.

    A ring is what the shipped bundles have, in all of them.
    """
    figure = Figure(figsize=(14.4, 8.8), layout="constrained")
    # The first is twice as wide: all switches change it.
    axes = list(figure.subplot_mosaic("aab;cde").values())
    for axis, name in zip(axes, _PICTURES, strict=False):
        _draw_losses(axis, rows, name)
    if combined:
        _draw_combinations(axes[len(_PICTURES)], combined)
    for axis in axes:
        axis.set_visible(axis.has_data())
    return figure


def _draw_losses(axis: Axes, rows: Sequence[SwitchRow], name: str) -> None:
    for k, switch in enumerate(SWITCHES):
        own = [row for row in rows if row.switch == switch.name and name in row.loss_db]
        if not any(row.loss_db[name] > 0 for row in own):
            continue
        x = [row.ms_per_hop for row in own]
        y = [max(row.loss_db[name], _MIN_LOSS_DB) for row in own]
        axis.plot(x, y, "o-", color=f"C{k}", markersize=4, linewidth=1, label=switch.title)
        for row, at_x, at_y in zip(own, x, y, strict=True):
            if row.is_default:
                axis.plot(at_x, at_y, **_RING)
            if row.loss_db[name] == 0 and k:
                continue
            axis.annotate(
                f"{row.value}",
                (at_x, at_y),
                textcoords="offset points",
                xytext=_NEARBY[k],
                ha="right" if _NEARBY[k][0] < 0 else "left",
                fontsize=7,
                color=f"C{k}",
            )
    axis.plot([], [], **_RING, label="as shipped")
    axis.set(
        xlabel="CPU per hop, ms",
        ylabel="loss, dB rms (1e-3: none)",
        title=f"{_PICTURES[name]} picture",
        xmargin=0.18,
        yscale="log",
        ylim=(_MIN_LOSS_DB / 2, 3 * max(row.loss_db.get(name, 0.0) for row in rows)),
    )
    axis.grid(visible=True, alpha=0.3)
    axis.legend(fontsize=7)


def _draw_combinations(axis: Axes, made: Sequence[Combination]) -> None:
    models = tuple(dict.fromkeys(c.model for c in made))
    for c in made:
        at, colour = (c.ms_per_hop, c.auc.value), f"C{models.index(c.model)}"
        axis.plot(*at, _MARKS[c.setting.cpis], color=colour, markersize=5)
        if c.is_shipped:
            axis.plot(*at, **_RING)
            axis.annotate(c.model, at, textcoords="offset points", xytext=(8, 4), color=colour)
    front = best(made)
    x, y = [c.ms_per_hop for c in front], [c.auc.value for c in front]
    axis.plot(x, y, "-", color="0.6", lw=1, zorder=0, label="nothing is cheaper and better")
    for cpis, mark in _MARKS.items():
        axis.plot([], [], mark, color="0.4", markersize=5, label=f"CPIs: {cpis}")
    axis.plot([], [], **_RING, label="as shipped")
    axis.set(xlabel="CPU per hop, ms", ylabel="window AUC", title="combinations")
    axis.grid(visible=True, alpha=0.3)
    axis.legend(fontsize=7, loc="lower right")


if __name__ == "__main__":
    sys.exit(main())
