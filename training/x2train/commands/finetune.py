"""`train-export finetune`: a bundle that knows one's own pet, from one's own clips."""

import argparse
from pathlib import Path

from rich.console import Console
from rich.table import Table

from radard.config.sections import AUTO_MODEL
from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from x2radar.commands import add_command
from x2train.commands import Commands, check_least, followed, result_console, told

_MAX_EPOCHS = 20  # a minute or two each


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "finetune",
        "teach a bundle one's own pet",
        "examples:\n"
        "  train-export dataset --out sets/guard --families 'held out' --like accurate\n"
        "  train-export dataset --out sets/mix --families train --like accurate --seed 73\n"
        "  train-export finetune --labels ~/.local/state/radard/labels.jsonl "
        "--guard sets/guard --mix sets/mix\n"
        "  train-export finetune rex1.h5=pet rex2.h5=pet me.h5=human --guard sets/guard "
        "--mix sets/mix\n"
        "  radard --model own.onnx\n",
    )
    add = parser.add_argument
    add("clips", nargs="*", metavar="FILE=LABEL", help="human, pet, other or wrong (no human)")
    add("--labels", type=Path, metavar="FILE", help="labels.jsonl of the dashboard")
    add("--clips", type=Path, dest="folder", metavar="DIR", help="where its clips are now")
    add("--model", default=AUTO_MODEL, help="bundle to start from (that which judges the clips)")
    add("--guard", type=Path, nargs="+", required=True, help="sets of people not to be missed")
    add("--mix", type=Path, nargs="+", required=True, help="simulated sets to learn from as well")
    add("--name", default="own", help="name of the new bundle (own)")
    add("--out", type=Path, default=Path(), help="its folder (this one)")
    add("--epochs", type=int, default=4, help="passes over the mix (4)")
    add("--seed", type=int, default=0, help="same seed, same file (0)")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    _check(args)
    from x2train.finetune import own_clips  # noqa: PLC0415
    from x2train.finetune.finetune import Tuned, load_guard, rows_of, tune, write_finetuned  # noqa: PLC0415

    console = result_console()
    clips = list(own_clips.named_clips(args.clips))
    if args.labels is not None:
        labelled, left_out = own_clips.labelled_clips(args.labels, args.folder)
        clips += labelled
        for line in left_out:
            console.print(f"left out: {line}")
    clips = list(own_clips.merged(clips))
    if args.model == AUTO_MODEL:
        args.model = own_clips.judge_of(clips)
        _check_name(args)
    bundle = load_bundle(args.model)
    guard = load_guard(args.guard, bundle)
    mix = load_guard(args.mix, bundle, least=1)
    # A spinner: how long replaying clips takes is not known.
    with Console(stderr=True).status("own clips"):
        own = [own_clips.own_windows(clip, bundle) for clip in clips]
    steps = tune(bundle, own, guard, mix, epochs=args.epochs, seed=args.seed)
    tuned: Tuned = followed(steps, args.epochs)
    path = args.out / args.name
    command = _command(args)
    write_finetuned(path, bundle, tuned, own=own, guard=guard, command=command, seed=args.seed)
    console.print(f"wrote {path}.onnx, .json and .md")
    table = Table("", "before", "after", box=None)
    for row in rows_of(tuned):
        table.add_row(*row)
    console.print(table)
    return 0


def _check(args: argparse.Namespace) -> None:
    if not 1 <= args.epochs <= _MAX_EPOCHS:
        raise UsageError(f"--epochs {args.epochs}: must be 1 to {_MAX_EPOCHS}")
    check_least(args, seed=0)
    if not args.clips and args.labels is None:
        raise UsageError("no clips: give FILE=LABEL, or --labels with the dashboard's file")
    if args.folder is not None and args.labels is None:
        raise UsageError("--clips says where the clips of --labels are; there is no --labels")
    if set(args.mix) & set(args.guard):
        msg = "--mix and --guard share a set: people learned from say nothing of people missed"
        raise UsageError(msg)
    _check_name(args)


def _check_name(args: argparse.Namespace) -> None:
    if Path(args.name).name != args.name or args.name == Path(args.model).stem:
        raise UsageError(f"--name {args.name}: a name of its own is wanted, without a folder")


def _command(args: argparse.Namespace) -> str:
    """Return the command, with the names of own files but not their folders."""
    clips = " ".join(
        f"{Path(file).name}={label}"
        for file, _, label in (text.rpartition("=") for text in args.clips)
    )
    labels = f"--labels {args.labels.name}" if args.labels else ""
    how = told(args, "guard mix epochs seed name")
    parts = ("train-export finetune", clips, labels, how, f"--model {Path(args.model).stem}")
    return " ".join(part for part in parts if part)
