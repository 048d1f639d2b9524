"""`train-export fit`: a network on maps, from sets of windows to a bundle."""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from radard.errors import UsageError
from radard.judge.bundle import CLASSES, Bundle, ModelInput, load_bundle, sidecar_path
from radard.judge.features import FeatureSettings, feature_shape
from x2radar.commands import add_command
from x2train.commands import Commands, check_least, followed, tell_bundle, told

WIDTHS = {
    "fast": ((8, 8, 12, 12), (8, 8, 12, 12), 24),
    "balanced": ((12, 16, 20, 20), (12, 16, 20, 20), 40),
    "accurate": ((24, 40, 48, 48), (20, 28, 36, 36), 80),
    "large": ((40, 80, 112, 112), (32, 56, 80, 80), 160),
}
"""Channels of networks: of branches, of those with longer CPIs, hidden."""
_BATCH = 128
_OUT = Path("models")
_STREAM_KEYS = ("frame_rate_hz", "bin_length_m", "carrier_hz", "bandwidth_hz")
_STREAMS = {
    name: dict(zip(_STREAM_KEYS, ranges, strict=True))
    for name, *ranges in (
        ("any", (14.5, 210.0), (0.0034, 0.054), (3.8e9, 8.0e9), (1.3e9, 2.6e9)),
        ("x2", (28.0, 210.0), (0.0034, 0.033), (6.5e9, 7.1e9), (2.1e9, 2.5e9)),
        ("x4m03", (38.0, 210.0), (0.0064, 0.054), (7.2e9, 8.9e9), (1.3e9, 1.5e9)),
    )
}
"""What bundles are for, by the radar of all the sets that they were calibrated on."""
_RECIPE = (
    "A small convolutional network on alias-suppressed velocity-time maps with three lengths of "
    "CPI and the range-time map of a dwell, trained on simulated people, pets and moving things "
    "in simulated rooms. Families kept out of training: {held_out}."
)


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "fit",
        "train a network on sets of windows, write a bundle",
        "example:\n"
        "  train-export fit --train sets/train --validate sets/validate --name balanced\n",
    )
    add = parser.add_argument
    add("--train", type=Path, nargs="+", required=True, help="sets to train on")
    text = "sets to calibrate on; the bundle is for their radars"
    add("--validate", type=Path, nargs="+", required=True, help=text)
    add("--name", default="balanced", help="name of the bundle (balanced)")
    add("--size", choices=sorted(WIDTHS), default="balanced", help="of the network (balanced)")
    add("--out", type=Path, default=_OUT, help="folder of the bundle (models)")
    add("--epochs", type=int, default=12, help="passes over the windows (12)")
    add("--seed", type=int, default=0, help="same seed, same file (0)")
    add("--half", action="store_true", help="compute in bfloat16: faster with AVX512-BF16 or AMX")
    add("--compile", action="store_true", help="compile it first: faster; needs a C++ compiler")
    add("--batch", type=int, default=_BATCH, help=f"windows a step ({_BATCH}); a GPU likes 512")
    add("--threads", type=int, default=1, help="of a processor; others, other weights (1)")
    text = "where to train: on a GPU if torch finds one (auto)"
    add("--device", choices=("auto", "cpu", "cuda"), default="auto", help=text)
    add("--teacher", metavar="MODEL", help="a bundle whose probabilities are learnt beside labels")
    add("--stream", choices=sorted(_STREAMS), help="what it is for (what --validate is of)")
    add("--start", metavar="MODEL", help="a bundle of this size whose weights are gone on from")
    text = "learn from all, not from those that show most: what goes on forgets the others"
    add("--all-windows", action="store_true", help=text)
    parser.set_defaults(run=_run)


def stream_of(abouts: Sequence[Mapping[str, Any]]) -> Mapping[str, tuple[float, float]]:
    """Return the streams that a bundle is for, from what the sets to calibrate on were made of."""
    radars = {str(about.get("radar", "any")) for about in abouts}
    return _STREAMS[radars.pop() if len(radars) == 1 else "any"]


def _run(args: argparse.Namespace) -> int:
    check_least(args, epochs=1, seed=0, batch=2, threads=1)
    from x2train.bundle import metrics  # noqa: PLC0415
    from x2train.bundle.export import DIFFERENCE, exported  # noqa: PLC0415
    from x2train.bundle.writing import write_bundle  # noqa: PLC0415
    from x2train.judge.verdicts import PET_LIMIT  # noqa: PLC0415
    from x2train.nets.bundle_answers import taught_by  # noqa: PLC0415
    from x2train.nets.map_fit import INPUTS, device_of, fit_maps  # noqa: PLC0415
    from x2train.nets.nets import MapFitSettings  # noqa: PLC0415
    from x2train.sets.window_set import load_windows, worth_learning  # noqa: PLC0415

    args.device = device_of(args.device)
    train, abouts = load_windows(*args.train, choose=None if args.all_windows else worth_learning)
    validation, judged = load_windows(*args.validate)
    if judged[0]["settings"] != abouts[0]["settings"]:
        msg = f"{args.validate[0]}: its maps were made with other settings than those to train on"
        raise UsageError(msg)
    metrics.check_calibration(validation["label"])
    features = FeatureSettings.from_mapping(abouts[0]["settings"])
    teacher = load_bundle(args.teacher) if args.teacher else None
    taught = taught_by(teacher, train, abouts[0], args.train[0]) if teacher else None
    start = load_bundle(args.start) if args.start else None
    same = ("epochs", "batch", "threads", "device", "seed")
    given: dict[str, Any] = {name: getattr(args, name) for name in same}
    given |= {"is_half": args.half, "is_compiled": args.compile}
    settings = MapFitSettings(*WIDTHS[args.size], **given)
    checkpoint = args.out / f"{args.name}.checkpoint"
    steps = fit_maps(
        train, validation, settings, taught=taught, checkpoint=checkpoint, start=start
    )
    trained = followed(steps, args.epochs)
    inputs = tuple(ModelInput(name, feature_shape(name, features), name) for name in INPUTS)
    # The teacher's training sets are not checked: they may hold any family.
    # Nor is what it started from.
    held_out = metrics.kept_out_of(abouts) if teacher is None and start is None else "none"
    training: dict[str, Any] = {
        "device": args.device,
        "recipe": _RECIPE.format(held_out=held_out),
        "command": _command(args),
        "seed": args.seed,
        "sets": abouts,
    }
    if teacher is not None:
        training["teacher"] = {"name": teacher.name, "onnx_sha256": teacher.sha256}
    if start is not None:
        training |= _started(args.start, start, training)
    evidence, measured = metrics.map_metrics(trained, validation, metrics.PRIOR_HUMAN[args.size])
    sample = {name: validation[name][: metrics.N_SAMPLE] for name in INPUTS}
    onnx_bytes, difference = exported(trained.net, inputs, sample)
    bundle = Bundle(
        name=args.name,
        onnx=onnx_bytes,
        inputs=inputs,
        features=features,
        stream=_STREAMS[args.stream] if args.stream else stream_of(judged),
        classes=CLASSES,
        temperature=trained.temperature,
        pet_limit=PET_LIMIT,
        policy="fused",
        evidence=asdict(evidence),
    )
    write_bundle(
        args.out,
        bundle,
        training=training,
        metrics={**measured, DIFFERENCE: difference},
        gate=metrics.gate_of(abouts),
        notes=metrics.NOTES,
    )
    tell_bundle(args.out / args.name, measured)
    return 0


def _started(model: str, start: Bundle, training: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a card says besides, of a bundle that another one was gone on from."""
    known = json.loads(sidecar_path(model).read_bytes())["training"]
    # A temporal head that it has is not gone on from.
    command = known["command"].split(" && train-export temporal")[0]
    return {
        "command": f"{command} && {training['command']}",
        "start": {"onnx_sha256": start.sha256, "sets": known["sets"]},
        "clips": known.get("clips", {}),
        # What began on a GPU does not come about again to the bit.
        **({"device": known["device"]} if known.get("device", "cpu") != "cpu" else {}),
    }


def _command(args: argparse.Namespace) -> str:
    args = argparse.Namespace(**vars(args))
    args.out = _OUT if args.out.is_absolute() else args.out
    usual: dict[str, Any] = {"half": False, "compile": False, "batch": _BATCH, "threads": 1}
    usual |= {"teacher": None, "start": None, "stream": None, "all_windows": False, "out": _OUT}
    return f"train-export fit {told(args, 'train validate name size epochs seed', **usual)}"
