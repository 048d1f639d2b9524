"""`train-export temporal`: a bundle learns to integrate evidence over successive windows."""

import argparse
from pathlib import Path

from rich.console import Console

from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from x2radar.commands import add_command
from x2train.commands import Commands, check_least, followed, tell_bundle, told

SIZES = {"fast": (12, 20, 0), "balanced": (16, 24, 0), "accurate": (48, 64, 8)}
"""Channels of the three bundles' heads: projected, hidden; of a second part, where it pays."""


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "temporal",
        "teach a bundle to integrate evidence over successive windows",
        "example:\n"
        "  train-export dataset --out sets/long --passages 8000 --longest 18\n"
        "  train-export temporal --model models/mine.onnx --train sets/train sets/long "
        "--validate sets/check\n",
    )
    add = parser.add_argument
    text = "a bundle without a temporal head, of three classes; of several, their mean"
    add("--model", nargs="+", required=True, help=text)
    add("--train", type=Path, nargs="+", required=True, help="sets to train on")
    add("--validate", type=Path, nargs="+", required=True, help="sets to calibrate on")
    add("--size", choices=sorted(SIZES), default="balanced", help="of the head (balanced)")
    add("--name", help="name of the new bundle (that of the old one)")
    add("--out", type=Path, default=Path("models"), help="folder of the new bundle (models)")
    text = "added to what speaks for a person: calibrates it on bodies nobody trained on (0)"
    add("--prior", metavar="NATS", type=float, default=0.0, help=text)
    add("--human-limit", type=float, help="no waiting from this p(human) on (by --size)")
    add("--leaning", metavar="P", type=float, help="likelier pets wait longer, people less")
    add("--brief", metavar="S", type=float, help="who leaves undecided sooner is passed over")
    add("--epochs", type=int, default=6, help="passes over the passages (6)")
    add("--seed", type=int, default=0, help="same seed, same file (0)")
    text = "a bundle whose head is gone on from; its networks are the last of --model"
    add("--start", metavar="MODEL", help=text)
    text = "of --model: heard apart as well; with --start what learns is how to hear these"
    add("--apart", metavar="MODEL", nargs="+", default=[], help=text)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_least(args, epochs=1, seed=0)
    from x2train.bundle.export import head_of, joined, spans_of  # noqa: PLC0415
    from x2train.bundle.metrics import check_calibration  # noqa: PLC0415
    from x2train.bundle.temporal_bundle import HUMAN_LIMIT, given_of_sets, write_temporal  # noqa: PLC0415
    from x2train.nets.temporal_head import HeadSettings, fit_head  # noqa: PLC0415

    parts = [load_bundle(model) for model in args.model]
    bundle = joined(parts)
    if strange := [model for model in args.apart if model not in args.model]:
        raise UsageError(f"--apart {strange[0]}: it is none of --model")
    spans = spans_of([part.onnx for part in parts])
    apart = tuple(spans[args.model.index(model)] for model in args.apart)
    size, epochs = SIZES[args.size], args.epochs
    settings = HeadSettings(*size, epochs=epochs, seed=args.seed, apart=apart)
    start = load_bundle(args.start).onnx if args.start else None
    # A spinner, not a bar: it leaves nothing behind, so an error stays one line.
    with Console(stderr=True).status("what the network sees"):
        train, abouts = given_of_sets(bundle, args.train)
        validation, _ = given_of_sets(bundle, args.validate)
        check_calibration(validation.given.label)
    weights = head_of(start, settings, train.given.values.shape[1]) if start else None
    trained = followed(fit_head(train.given, validation.given, settings, weights), epochs)
    name = args.name or bundle.name
    limit = HUMAN_LIMIT[args.size] if args.human_limit is None else args.human_limit
    more = {"prior_human": args.prior or None, "leaning": args.leaning, "brief_s": args.brief}
    metrics = write_temporal(
        args.out,
        name,
        args.model,
        bundle,
        trained,
        validation=validation,
        abouts=abouts,
        command=_command(args),
        evidence={"human_limit": limit, **{k: v for k, v in more.items() if v is not None}},
    )
    tell_bundle(args.out / name, metrics)
    return 0


def _command(args: argparse.Namespace) -> str:
    waits = dict.fromkeys(("human_limit", "leaning", "brief"))
    base = told(args, "model train validate size", name=None, prior=0.0, **waits)
    return f"train-export temporal {base} {told(args, 'epochs seed', start=None, apart=[])}"
