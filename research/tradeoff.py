"""What speed costs in accuracy, switch by switch, bundle by bundle: `docs/tradeoff.md`."""

import argparse
import os
import platform
import sys
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from study import check_picture, check_within, run_script, save, script_parser
from tradeoff_bundles import (
    PRECISIONS,
    SETTINGS,
    BundleRow,
    Combination,
    best,
    check_combined,
    combinations,
    judged_windows,
    read_accuracy,
    time_bundle,
)
from tradeoff_chain import SWITCHES, Switch, SwitchRow, chain_ms, measure, record
from x2train.commands import counted

_OTHER_SHARE, _OTHER_SEED = 4, 1  # a quarter of the passages, other ones, calibrate int8
_PROFILES = ("fast", "balanced", "accurate")  # bundles that `radard --profile` names
_PICTURES = {
    "velocity_time": "velocity-time",
    "velocity_time_medium": "medium CPI",
    "velocity_time_long": "long CPI",
    "range_time": "range-time",
    "spectrogram": "spectrogram",
}
_MEANING = {
    "decimation": "Bins of 3.7 mm times this. The matched filter comes first, so no noise folds.",
    "stride": "Frames from one velocity column to the next; pictures have cells of 50 ms.",
    "step_mps": "401, 201, 101, 51 and 25 rows from -5 to 5 m/s. A CPI of 0.2 s resolves "
    "0.15 m/s.",
    "cpis": "CPIs of 0.2, 0.6 and 1.5 s; of 0.2 and 0.6 s; of 0.2 s alone. What the longer ones "
    "are worth to a network that is trained so: [what was tried](research/evaluation-tried.md).",
    "precision": "Arithmetic of the maps; frames are float32 either way.",
    "source": "RF that is down-converted here, or baseband that the module made. The loss is "
    "mostly another draw of the receiver's noise.",
    "bands": "Spectrogram alone. One band is what sums over range leave of it.",
}
_MIN_LOSS_DB = 1e-3  # drawn for none
_N_ACROSS = 3  # plots in a row
_MARKS = {3: "o", 2: "s", 1: "^"}  # of combinations, by their CPIs


def main(argv: Sequence[str] | None = None) -> int:
    """Measure switches, bundles and combinations; write page and plot."""
    parser = script_parser(
        "tradeoff",
        "Measure what every switch costs and loses.",
        "--models fast=fast.json balanced=balanced.json accurate=accurate.json\n"
        "--combine fast balanced accurate",
    )
    add = parser.add_argument
    add("--scenes", nargs="+", default=["human", "dog", "fan"], metavar="SCENE", help="built-in")
    add("--draws", type=int, default=2, help="seeds of every scene (2)")
    add("--seed", type=int, default=0, help="the first of them (0)")
    add("--duration", type=float, default=14.0, metavar="S", help="seconds of each (14)")
    add("--rate", type=float, default=60.0, metavar="HZ", help="frames per second (60)")
    add("--rounds", type=int, default=5, help="how often everything is timed (5)")
    add(
        "--models",
        nargs="+",
        default=[],
        metavar="NAME[=REPORT.json]",
        help="bundles to time, with their evaluation",
    )
    add(
        "--combine",
        nargs="+",
        default=[],
        metavar="NAME",
        help="bundles to judge with every combination of maps, precision and decimation",
    )
    add("--passages", type=int, default=400, help="passages that they are judged by (400)")
    add("--page", type=Path, default=Path("docs/tradeoff.md"), metavar="FILE", help="table")
    add("--plot", type=Path, default=Path("docs/images/tradeoff.png"), metavar="FILE", help="plot")
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
    combined = [load_bundle(name) for name in args.combine]
    for bundle in combined:
        check_combined(bundle)
    wanted = [parse_model(text) for text in args.models]
    known = [(name, read_accuracy(path) if path else None) for name, path in wanted]
    seeds = range(args.seed, args.seed + args.draws)
    recordings = [record(s, args.rate, args.duration, k) for s in args.scenes for k in seeds]
    bundles = [time_bundle(name, found, recordings, args.rounds) for name, found in known]
    made: list[Combination] = []
    grid: list[str] = []
    if combined:
        counts = (args.passages, args.passages // _OTHER_SHARE)
        with counted("passages") as tell:
            windows, others = (
                judged_windows(n, args.seed + more, combined, tell)
                for n, more in zip(counts, (0, _OTHER_SEED), strict=True)
            )
        with counted("timing") as tell:
            cost_ms = chain_ms(recordings, SETTINGS, args.rounds, tell)
        made = combinations(combined, windows, others, cost_ms, args.seed)
        grid = grid_section(made, len(windows.passage), int(windows.passage.max()) + 1)
    with counted("switches") as tell:
        rows = measure(recordings, args.rounds, tell)
    save(drawn(rows, made), args.plot, 110)
    plot = os.path.relpath(args.plot, args.page.parent).replace(os.sep, "/")
    text = page(rows, bundles, grid, how=_how(args), command=_command(args), plot=plot)
    args.page.parent.mkdir(parents=True, exist_ok=True)
    args.page.write_text(text, encoding="utf-8")


def parse_model(text: str) -> tuple[str, Path | None]:
    """Return bundle and evaluation of ``NAME`` or ``NAME=REPORT.json``."""
    name, equals, file = text.partition("=")
    if not name or (equals and not file):
        msg = f"--models '{text}': must be NAME or NAME=REPORT.json"
        raise UsageError(msg)
    return name, Path(file) if file else None


def _how(args: argparse.Namespace) -> str:
    scenes = ", ".join(args.scenes)
    draws = f"{args.draws} draws of {args.duration:g} s each, X2 at {args.rate:g} Hz"
    return f"Scenes {scenes} ({draws}), one thread of {_processor()}."


def _processor() -> str:
    """Return the processor's name, as far as the system tells it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def _command(args: argparse.Namespace) -> str:
    parts = ["python research/tradeoff.py"]
    if args.models:
        parts.append("--models " + " ".join(args.models))
    if args.combine:
        parts.append(f"--combine {' '.join(args.combine)} --passages {args.passages}")
    return " ".join(parts)


def page(
    rows: Sequence[SwitchRow],
    bundles: Sequence[BundleRow],
    grid: Sequence[str],
    *,
    how: str,
    command: str,
    plot: str,
) -> str:
    """Return the page in Markdown.

    `how` is a sentence on scenes and machine, `command` what made it, `plot` where the plot lies
    from the page; `bundles` and `grid`, the section of `grid_section`, may be empty.
    """
    parts = [
        "# Speed against accuracy",
        "",
        f"Made by `{command}`. Do not edit: run it again.",
        "",
        how,
        "",
        "**ms** is the CPU time of one hop (one a second) with an open gate: down-conversion,",
        "clutter and jitter, maps, pictures. **ratio** is that against the switch's finest value",
        "in the same run. **loss** is how far a picture is from the one of the finest value,",
        "everything else alike: rms over all that either shows, in dB (25 dB deep for the",
        "short CPI, 30 dB for the others); pictures that stay alike are left out. **Bold** is",
        "what the shipped bundles have.",
        "",
        f"![loss against cost]({plot})",
        "",
    ]
    for switch in SWITCHES:
        parts += [*_table(switch, [row for row in rows if row.switch == switch.name]), ""]
    parts += _bundle_table(bundles)
    if grid:
        parts += ["", *grid]
    return "\n".join(parts).rstrip("\n") + "\n"


def _table(switch: Switch, rows: Sequence[SwitchRow]) -> list[str]:
    # What a switch does not change is not worth a column.
    names = [name for name in rows[0].loss_db if any(row.loss_db.get(name) != 0 for row in rows)]
    heads = " | ".join(f"loss {_PICTURES[name]}, dB" for name in names)
    lines = [
        f"## {switch.title[:1].upper()}{switch.title[1:]}",
        "",
        _MEANING[switch.name],
        "",
        f"| value | ms | ratio | {heads} |",
        "|---|---|---|" + "---|" * len(names),
    ]
    for row in rows:
        value = f"**{row.value}**" if row.is_default else f"{row.value}"
        losses = " | ".join(
            f"{row.loss_db[name]:.2g}" if name in row.loss_db else "not made" for name in names
        )
        lines.append(f"| {value} | {row.ms_per_hop:.2f} | {row.ratio:.2f} | {losses} |")
    return lines


def _bundle_table(bundles: Sequence[BundleRow]) -> list[str]:
    if not bundles:
        return []
    lines = [
        "## Bundles",
        "",
        "CPU of one hop of the daemon with an open gate, every track judged by itself, timed in",
        "this run; accuracy over windows from each bundle's evaluation, with its 95 % interval.",
        "Only accuracies of evaluations on the same windows can be compared.",
        "",
        "| bundle | ms | of it network | accuracy |",
        "|---|---|---|---|",
    ]
    for row in sorted(bundles, key=lambda each: each.ms_per_hop):
        name = f"**{row.name}** (profile)" if row.name in _PROFILES else row.name
        a = row.accuracy
        accuracy = f"{a.value:.4f} ({a.low:.4f} to {a.high:.4f})" if a else "not evaluated"
        lines.append(f"| {name} | {row.ms_per_hop:.2f} | {row.network_ms:.2f} | {accuracy} |")
    return lines


def grid_section(made: Sequence[Combination], n_windows: int, n_passages: int) -> list[str]:
    """Return the section of the page on combinations, as lines of Markdown."""
    models = tuple(dict.fromkeys(c.model for c in made))
    columns = [(model, precision) for model in models for precision in PRECISIONS]
    found = {(c.model, c.precision, c.decimation, c.cpis): c for c in made}
    widest = max(c.auc.high - c.auc.low for c in made) / 2
    first = SETTINGS[0]
    costs = (found[m, p, first.decimation, first.cpis].network_ms for m, p in columns)
    lines = [
        "## Combinations",
        "",
        f"Window AUC, people against pets, over {n_windows} windows of {n_passages} simulated",
        "passages before an X2 with all its bins, the same dwells in every row. *Range*: how",
        "many bins become one; *CPIs*: how many velocity-time maps the network is shown, the",
        "others are blank. **ms**: CPU time of a hop without network; that of the network is in",
        "the second row. **Bold** is as shipped, a star that nothing else is both cheaper and",
        f"better. 95 % intervals (passages resampled) reach {widest:.3f} to either side at most,",
        "less for differences. No network was retrained: one made for what it is shown might do",
        "better. Weights in int8 use seven bits: without dot-product instructions (VNNI)",
        "onnxruntime adds pairs of products in 16 bits, which eight-bit weights saturate (one",
        "probability was off by 0.76).",
        "",
        "| range | CPIs | ms | " + " | ".join(f"{m}, {p}" for m, p in columns) + " |",
        "|---|---|---|" + "---|" * len(columns),
        "| | | network, ms: | " + " | ".join(f"{ms:.2f}" for ms in costs) + " |",
    ]
    front = best(made)
    for setting in SETTINGS:
        row = [found[m, p, setting.decimation, setting.cpis] for m, p in columns]
        told = [f"**{c.auc.value:.3f}**" if c.is_shipped else f"{c.auc.value:.3f}" for c in row]
        cells = [f"{t} *" if c in front else t for t, c in zip(told, row, strict=True)]
        ms = row[0].ms_per_hop - row[0].network_ms
        lines.append(f"| {setting.decimation} | {setting.cpis} | {ms:.2f} | {' | '.join(cells)} |")
    return lines


def drawn(rows: Sequence[SwitchRow], combined: Sequence[Combination]) -> Figure:
    """Draw loss against cost, picture by picture, and AUC against cost of combinations."""
    n_rows = -(-(len(_PICTURES) + 1) // _N_ACROSS)
    figure = Figure(figsize=(4.8 * _N_ACROSS, 4.4 * n_rows), layout="constrained")
    axes = figure.subplots(n_rows, _N_ACROSS).ravel()
    for axis, name in zip(axes, _PICTURES, strict=False):
        _draw_losses(axis, rows, name)
    if combined:
        _draw_combinations(axes[-1], combined)
    else:
        axes[-1].set_axis_off()
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
            axis.annotate(
                f"{row.value}",
                (at_x, at_y),
                textcoords="offset points",
                xytext=(4, 3),
                fontsize=7,
                color=f"C{k}",
                fontweight="bold" if row.is_default else "normal",
            )
    axis.set(
        xlabel="CPU per hop, ms",
        ylabel="loss, dB rms (1e-3: none)",
        title=f"{_PICTURES[name]} picture",
        yscale="log",
        ylim=(_MIN_LOSS_DB / 2, None),
    )
    axis.grid(visible=True, alpha=0.3)
    axis.legend(fontsize=7)


def _draw_combinations(axis: Axes, made: Sequence[Combination]) -> None:
    models = tuple(dict.fromkeys(c.model for c in made))
    for c in made:
        colour = f"C{models.index(c.model)}"
        face = colour if c.precision == PRECISIONS[0] else "none"
        at = (c.ms_per_hop, c.auc.value)
        axis.plot(*at, _MARKS[c.cpis], color=colour, markerfacecolor=face, markersize=5)
        if c.is_shipped:
            axis.plot(*at, "*", color=colour, markersize=15, label=c.model)
    front = best(made)
    x, y = [c.ms_per_hop for c in front], [c.auc.value for c in front]
    axis.plot(x, y, "-", color="0.6", linewidth=1, zorder=0)
    for cpis, mark in _MARKS.items():
        axis.plot([], [], mark, color="0.4", markersize=5, label=f"CPIs: {cpis}")
    axis.plot([], [], "o", color="0.4", markerfacecolor="none", markersize=5, label="int8")
    axis.set(
        xlabel="CPU per hop, ms", ylabel="window AUC", title="combinations (star: as shipped)"
    )
    axis.grid(visible=True, alpha=0.3)
    axis.legend(fontsize=7, loc="lower right")


if __name__ == "__main__":
    sys.exit(main())
