"""`train-export thesis`: the thesis, run again from its data to its tables."""

import argparse
import os
import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radard.errors import UsageError
from x2radar.commands import add_command
from x2train.commands import Commands, progress, result_console, stages, tell_bundle, told

if TYPE_CHECKING:
    from x2train.thesis.recipe import CellResult, Job, StudyRecipe, Variant

_EXAMPLES = """\
examples:
  train-export thesis                                   all eight sets, both activations
  train-export thesis --animal dog --frame-rate 60 --repeats 3
  train-export thesis --finetune walks.h5=human dogs.h5=dog    retrain on recordings
  train-export thesis --share 0.01 --publish try.md     all of it within a minute, to try it
  train-export thesis --publish docs/thesis-results.md    everything, and the page
  train-export thesis --bundle models/mine              a bundle of such a network
A run that was interrupted goes on with the next training when the command is given again.
"""
PARTS = ("networks", "own", "switches")
_TRIAL = {"share": 0.01, "animal": "dog", "frame_rate": 60, "parts": "networks,own"}
"""What the page has beside its command: a minute of one core."""
_ONE = {"animal": "dog", "frame_rate": 60, "vector": 2, "parts": "networks", "finetune": None}
"""One set whole: ten minutes."""
_ELEMENTS = ("elements", "fresh")
_MIN_ELEMENTS = 60  # of a share: three of each class evaluate


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands, "thesis", "the thesis, reproduced: data, training, tables, pictures", _EXAMPLES
    )
    _add_data(parser.add_argument_group("data"))
    _add_training(parser.add_argument_group("training"))
    add = parser.add_argument
    text = (
        "of networks (the thesis'), own (our features), switches (section 7 of its plans); "
        "networks by default, all with --publish"
    )
    add("--parts", metavar="LIST", help=text)
    add("--rows", nargs="+", metavar="NAME", help="of switches, by the page's names (all)")
    text = "of cache and results (build/thesis)"
    add("--folder", type=Path, default=Path("build/thesis"), help=text)
    add("--bundle", type=Path, metavar="PATH", help="train one network for the daemon instead")
    add("--publish", type=Path, metavar="FILE", help="write tables and pictures here")
    add("--kept", action="store_true", help="train nothing: show what earlier runs have kept")
    parser.set_defaults(run=_run)


def _add_data(group: Any) -> None:
    add = group.add_argument
    add("--elements", type=int, default=5000, help="of a data set; a tenth evaluates (5000)")
    add("--fresh", type=int, default=5000, help="further elements that judge (5000)")
    add("--frame-rate", type=int, metavar="HZ", help="60, 200 or any; both by default")
    add("--animal", choices=("dog", "cat"), help="both by default")
    add("--vector", type=int, choices=(1, 2), help="both by default")
    add("--cpi", type=int, default=28, metavar="M", help="frames of a Doppler window (28)")
    add("--cadences", type=int, default=28, metavar="N", help="columns of D that are used (28)")
    add("--noise", choices=("input", "printed"), default="input", help="its reference (input)")
    add("--clutter", action="store_true", help="add static echoes")
    add("--rectified", action="store_true", help="range profiles with the peak on the left")
    add("--train-rate", type=int, metavar="HZ", help="train at another frame rate")
    add("--seed", type=int, default=0, help="same seed, same results (0)")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes (all cores)")
    add("--share", type=float, default=1.0, metavar="F", help="of all that, to try it (1)")


def _add_training(group: Any) -> None:
    add = group.add_argument
    add("--repeats", type=int, default=10, help="initial weights tried (10)")
    add("--activation", choices=("relu", "sigmoid", "tanh"), help="relu and sigmoid by default")
    add("--layers", default="100,50", help="hidden layers (100,50)")
    add("--outputs", type=int, choices=(1, 2), default=2, help="softmax of two, or one (2)")
    add("--error", choices=("cross-entropy", "mse"), default="cross-entropy", help="(the first)")
    add("--optimiser", choices=("adam", "momentum", "lbfgs"), default="adam", help="(adam)")
    add("--rate", type=float, default=0.001, help="learning rate (0.001)")
    add("--momentum", type=float, default=0.9, help="(0.9)")
    add("--batch", type=int, default=100, help="elements a step (100)")
    add("--decay", type=float, help="of weights: L2 (0.7; sigmoid and tanh less)")
    add("--averaging", type=float, default=0.999, help="of weights, 0 for none (0.999)")
    add("--sparsity", type=float, default=0.0, help="penalty on the autoencoders' codes (0)")
    add("--scaling", choices=("none", "block", "each"), help="of inputs (none; sigmoid block)")
    add("--pretrain", default="500,100", help="epochs of the autoencoders; '' for none (500,100)")
    add("--output-epochs", type=int, default=400, help="of the output layer (400)")
    add("--epochs", type=int, default=2000, help="of the whole network, at most (2000)")
    add("--look-every", type=int, default=100, help="epochs between looks (100)")
    add("--patience", type=int, default=2, help="looks without a gain that end it (2)")
    text = "recordings with labels in them, or of one: pet, dog, cat, human or person"
    add("--finetune", type=Path, nargs="+", metavar="FILE[=LABEL]", help=text)
    add("--own-epochs", type=int, default=30, help="of the network on our features (30)")
    add("--own-repeats", type=int, default=3, help="its initial weights (3)")


def _run(args: argparse.Namespace) -> int:
    # Late: torch takes seconds, and --help must not.
    from x2train.thesis.recipe import StudyRecipe  # noqa: PLC0415

    parts = _parts(args)
    given, args = args, _small(args)
    sizes = {"n_elements": args.elements // 20 * 20, "n_fresh": args.fresh // 2 * 2}
    of_maps = {"n_cpi": args.cpi, "n_cadence": args.cadences}
    recipe = StudyRecipe(
        folder=args.folder, seed=args.seed, workers=args.workers, **sizes, **of_maps
    )
    if args.bundle:
        return _bundle(args, recipe, given)
    jobs = list(_jobs(args, recipe, parts))
    results: list[CellResult] = []
    with progress() as bar:
        overall = bar.add_task("trainings", total=len(jobs))
        tell = stages(bar)
        for job in jobs:
            result = job.kept() if args.kept else job.run(tell)
            if result is not None:
                results.append(result)
            bar.advance(overall)
    console = result_console()
    for r in results:
        console.print(
            f"{r.name} {r.label}: {r.evaluation.total[r.best]:.1f} % on {r.evaluation.n}, "
            f"{r.fresh.median:.1f} % on {r.fresh.n} fresh elements"
        )
    if not results:
        raise UsageError(f"{args.folder}: no results of these settings; run without --kept")
    if args.publish:
        from x2train.thesis.pictures import publish  # noqa: PLC0415

        trial, one = (argparse.Namespace(**{**vars(given), **more}) for more in (_TRIAL, _ONE))
        commands = (
            _command(given, "--publish", f"docs/{args.publish.name}"),
            _command(trial, "--folder", "build/trial", "--publish", "build/trial.md"),
            _command(one, "--publish", "build/T2D60.md"),
        )
        console.print(str(publish(recipe, results, args.publish, commands)))
    return 0


def _small(args: argparse.Namespace) -> argparse.Namespace:
    """Return the arguments with `--share` of the elements, repeats and epochs."""
    if not 0 < args.share <= 1:
        raise UsageError(f"--share {args.share:g}: must be above 0, and 1 at most")
    if args.share == 1:
        return args
    made = argparse.Namespace(**vars(args))
    for name in (*_ELEMENTS, "repeats", "epochs", "output_epochs", "own_epochs", "own_repeats"):
        least = _MIN_ELEMENTS if name in _ELEMENTS else 1
        setattr(made, name, max(least, round(args.share * getattr(args, name))))
    epochs = _whole_numbers("--pretrain", args.pretrain)
    made.pretrain = ",".join(str(max(1, round(args.share * n))) for n in epochs)
    made.look_every = min(args.look_every, made.epochs)
    return made


def _bundle(args: argparse.Namespace, recipe: "StudyRecipe", given: argparse.Namespace) -> int:
    """Write a bundle: of the type 2 vector of dogs and cats at 60 Hz, unless told otherwise."""
    from x2train.thesis.bundle import write_thesis_bundle  # noqa: PLC0415
    from x2train.thesis.sets import Cell  # noqa: PLC0415

    if args.rectified:
        raise UsageError("--rectified: the daemon makes no such profiles for a bundle")
    cell = Cell(args.vector or 2, args.animal or "pet", args.frame_rate or 60)
    variant = _variant(args, args.activation or "relu")
    command = _command(given, "--bundle", f"models/{args.bundle.name}")
    with progress() as bar:
        tell = stages(bar)
        metrics = write_thesis_bundle(args.bundle, recipe, cell, variant, tell, command=command)
    tell_bundle(args.bundle, metrics)
    return 0


def _parts(args: argparse.Namespace) -> tuple[str, ...]:
    if args.parts is None:
        return PARTS if args.publish else PARTS[:1]
    parts = tuple(part.strip() for part in args.parts.split(",") if part.strip())
    if not parts or set(parts) - set(PARTS):
        raise UsageError(f"--parts '{args.parts}': must be of {', '.join(PARTS)}")
    return parts


def _jobs(
    args: argparse.Namespace, recipe: "StudyRecipe", parts: tuple[str, ...]
) -> Iterator["Job"]:
    from x2train.thesis.own import RAW, OwnSettings, own_job, raw_job  # noqa: PLC0415
    from x2train.thesis.recipe import network_job, variants, wanted_cells  # noqa: PLC0415
    from x2train.thesis.sets import CELLS, load_recordings  # noqa: PLC0415

    cells = wanted_cells(args.vector, args.animal, args.frame_rate)
    names = (args.activation,) if args.activation else ("relu", "sigmoid")
    plain = {name: _variant(args, name) for name in names}
    for cell in cells:
        # Validates the settings before anything is simulated.
        recipe.spec(cell.frame_rate_hz)
        if args.train_rate is not None:
            recipe.spec(args.train_rate)
    if "networks" in parts and (args.publish or not args.finetune):
        yield from (network_job(recipe, cell, v) for v in plain.values() for cell in cells)
    if "own" in parts:
        own = OwnSettings(epochs=args.own_epochs, repeats=args.own_repeats, seed=args.seed)
        # One for every animal and frame rate.
        kinds = dict.fromkeys(replace(cell, vector=2) for cell in cells)
        yield from (own_job(recipe, cell, own) for cell in kinds)
    tried = next(c for c in (*cells, *CELLS) if c.vector == 2)
    if "switches" in parts:
        base = _variant(args, "relu").fit
        rows: dict[str, Job] = {v.label: network_job(recipe, tried, v) for v in variants(base)}
        rows[RAW] = raw_job(recipe, tried, base)
        if wrong := set(args.rows or ()) - set(rows):
            raise UsageError(f"--rows {', '.join(sorted(wrong))}: must be of {', '.join(rows)}")
        yield from (rows[name] for name in args.rows or rows)
    if args.finetune:
        wanted = cells if "networks" in parts and not args.publish else (tried,)
        named = replace(plain[names[0]], label=f"{names[0]} retrained")
        for cell in wanted:
            spec = recipe.spec(cell.frame_rate_hz)
            recordings = load_recordings(args.finetune, spec, cell.vector)
            yield network_job(recipe, cell, named, recordings)


def _variant(args: argparse.Namespace, activation: str) -> "Variant":
    from x2train.thesis.fit import fit_settings  # noqa: PLC0415
    from x2train.thesis.recipe import Variant  # noqa: PLC0415

    names = (
        *("error", "optimiser", "momentum", "batch", "decay", "averaging", "sparsity"),
        *("scaling", "output_epochs", "epochs", "look_every", "patience", "repeats", "seed"),
    )
    fit = fit_settings(
        activation,
        layers=_whole_numbers("--layers", args.layers),
        pretrain_epochs=_whole_numbers("--pretrain", args.pretrain),
        n_outputs=args.outputs,
        learning_rate=args.rate,
        **{name: value for name in names if (value := getattr(args, name)) is not None},
    )
    data = {name: getattr(args, name) for name in ("rectified", "clutter", "noise")}
    return Variant(label=activation, fit=fit, train_rate_hz=args.train_rate, **data)


def _whole_numbers(option: str, text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(",") if part.strip())
    except ValueError as err:
        raise UsageError(f"{option} '{text}': must be whole numbers with commas between") from err


def _command(args: argparse.Namespace, *more: str) -> str:
    """Return the command line again, without what only says where and how fast."""
    parser = argparse.ArgumentParser()
    _add_data(parser)
    _add_training(parser)
    parser.add_argument("--parts")
    plain = vars(parser.parse_args([]))
    del plain["workers"]
    made = argparse.Namespace(**vars(args))
    made.finetune = args.finetune and [path.name for path in args.finetune]
    words = ("train-export thesis", told(made, "", **plain), shlex.join(more))
    return " ".join(filter(None, words))
