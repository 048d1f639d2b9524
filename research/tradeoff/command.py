"""`train-export tradeoff`: what speed costs in accuracy, switch by switch, bundle by bundle."""

import argparse
import os
import platform
from pathlib import Path
from typing import TYPE_CHECKING

from radard.errors import UsageError
from radard.judge.bundle import Bundle, load_bundle
from x2radar.commands import add_command
from x2train.commands import Commands, last

if TYPE_CHECKING:
    from research.tradeoff.combinations import Combination
    from research.tradeoff.measure import Recording

_EXAMPLES = """\
examples:
  train-export tradeoff
  train-export tradeoff --models fast=fast.json balanced=balanced.json accurate=accurate.json
  train-export tradeoff --combine fast balanced accurate
"""
_OTHER_SHARE = 4  # a quarter of the passages calibrate int8: chosen
_OTHER_SEED = 1  # so that they are other ones


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands,
        "tradeoff",
        "measure what every switch costs and loses",
        _EXAMPLES,
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
        metavar="NAME[=EVALUATION.json]",
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
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    _check(args)
    # Late: matplotlib and onnxruntime take a second, and --help must not.
    from research.tradeoff.combinations import check_combined  # noqa: PLC0415
    from research.tradeoff.measure import measure, n_steps, record  # noqa: PLC0415
    from research.tradeoff.models import parse_model, read_accuracy, time_model  # noqa: PLC0415
    from research.tradeoff.page import draw, page  # noqa: PLC0415

    combined = [load_bundle(name) for name in args.combine]
    for bundle in combined:
        check_combined(bundle)
    wanted = [parse_model(text) for text in args.models]
    known = [(name, read_accuracy(path) if path else None) for name, path in wanted]
    seeds = range(args.seed, args.seed + args.draws)
    recordings = [record(s, args.rate, args.duration, k) for s in args.scenes for k in seeds]
    models = [time_model(name, found, recordings, args.rounds) for name, found in known]
    made, grid = _combined(combined, recordings, args)
    rows = last(measure(recordings, args.rounds), n_steps(args.rounds), "measuring")
    draw(rows, models, made, args.plot)
    text = page(
        rows,
        models,
        grid,
        how=_how(args),
        command=_command(args),
        plot=os.path.relpath(args.plot, args.page.parent).replace(os.sep, "/"),
    )
    args.page.parent.mkdir(parents=True, exist_ok=True)
    args.page.write_text(text, encoding="utf-8")
    return 0


def _combined(
    bundles: list[Bundle], recordings: "list[Recording]", args: argparse.Namespace
) -> "tuple[list[Combination], list[str]]":
    """Return all combinations of some bundles, and their section of the page."""
    if not bundles:
        return [], []
    from research.tradeoff.combinations import (  # noqa: PLC0415
        DECIMATIONS,
        SETTINGS,
        combinations,
        features_of,
        n_combinations,
    )
    from research.tradeoff.grid_page import grid_section  # noqa: PLC0415
    from research.tradeoff.measure import chain_ms  # noqa: PLC0415
    from research.tradeoff.windows import judged_windows  # noqa: PLC0415

    kinds = features_of(bundles)
    windows, others = (
        last(judged_windows(n, args.seed + more, kinds, DECIMATIONS), n, "passages")
        for n, more in ((args.passages, 0), (args.passages // _OTHER_SHARE, _OTHER_SEED))
    )
    cost_ms = last(
        chain_ms(recordings, SETTINGS, args.rounds), len(SETTINGS) * args.rounds, "timing"
    )
    made = last(
        combinations(bundles, windows, others, cost_ms, args.seed),
        n_combinations(len(bundles)),
        "combinations",
    )
    return made, grid_section(made, len(windows.passage), int(windows.passage.max()) + 1)


def _check(args: argparse.Namespace) -> None:
    for name, low, high in (
        ("draws", 1, 100),
        ("rounds", 1, 100),
        ("rate", 20, 400),
        ("passages", 12, 100_000),
    ):
        if not low <= getattr(args, name) <= high:
            msg = f"--{name} {getattr(args, name):g}: must be {low} to {high}"
            raise UsageError(msg)
    if not 5 <= args.duration <= 600:
        msg = f"--duration {args.duration:g}: must be 5 to 600 seconds"
        raise UsageError(msg)
    if args.seed < 0:
        msg = f"--seed {args.seed}: must be 0 or more"
        raise UsageError(msg)
    if args.plot.suffix not in {".png", ".pdf", ".svg"}:
        msg = f"--plot {args.plot}: must end in .png, .pdf or .svg"
        raise UsageError(msg)


def _how(args: argparse.Namespace) -> str:
    scenes = ", ".join(args.scenes)
    draws = f"{args.draws} draws of {args.duration:g} s each, X2 at {args.rate:g} Hz"
    return f"Scenes {scenes} ({draws}), one thread of {_processor()}."


def _processor() -> str:
    """Return the processor's name, as far as the system tells it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _command(args: argparse.Namespace) -> str:
    parts = ["train-export tradeoff"]
    if args.models:
        parts.append("--models " + " ".join(args.models))
    if args.combine:
        parts.append(f"--combine {' '.join(args.combine)} --passages {args.passages}")
    return " ".join(parts)
