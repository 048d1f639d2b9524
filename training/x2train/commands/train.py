"""`train-export train`: the base-line bundle, from simulation to ONNX."""

import argparse
import os
from pathlib import Path

from radard.classify.bundle import ModelInput
from radard.classify.features import FeatureSettings
from x2train.commands import Commands, check_least, last, progress, tell_bundle
from x2train.studies.baseline.dataset import CLASSES, LabelledSet, ThesisSetSpec, generate

_RECIPE = (
    "The thesis' network (1176-100-50-2, ReLU) on its type 2 vector, trained on the thesis' "
    "five-sinusoid bodies: people against dogs and cats at 60 Hz. A base line: it knows these "
    "bodies, not real motion."
)


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "train",
        help="make a data set, train, write a bundle",
        epilog="example:\n  train-export train --elements 2000 --out /tmp/models --name quick\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--name", default="thesis", help="name of the bundle (thesis)")
    add("--out", type=Path, default=Path("models"), help="folder of the bundle (models)")
    add("--elements", type=int, default=12_000, help="windows to train on (12000)")
    add("--epochs", type=int, default=60, help="passes over them (60)")
    add("--seed", type=int, default=0, help="same seed, same file (0)")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes (all cores)")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_least(args, elements=100, epochs=1, seed=0, workers=1)
    return _train(args)


def _train(args: argparse.Namespace) -> int:
    # Late: torch takes seconds, and --help must not.
    from x2train.bundles.export import PARITY, BundleSpec, parity, to_onnx, write_bundle  # noqa: PLC0415
    from x2train.nets.epoch import Epoch  # noqa: PLC0415
    from x2train.studies.baseline.evaluate import window_metrics  # noqa: PLC0415
    from x2train.studies.baseline.train import Trained, TrainSettings, fit  # noqa: PLC0415

    name: str = args.name
    out: Path = args.out
    elements: int = args.elements
    epochs: int = args.epochs
    seed: int = args.seed
    settings = FeatureSettings()
    n_held = max(100, elements // 6)
    parts: dict[str, LabelledSet] = {}
    for k, (part, n) in enumerate((("train", elements), ("validate", n_held), ("test", n_held))):
        # Far apart, so that no element of one part is an element of another.
        spec = ThesisSetSpec(n_elements=n, seed=1000 * seed + k, settings=settings)
        parts[part] = last(generate(spec, workers=args.workers), n, f"simulate {part}")
    trained: Trained | None = None
    with progress() as bar:
        task = bar.add_task("train", total=epochs)
        for step in fit(
            parts["train"], parts["validate"], TrainSettings(epochs=epochs, seed=seed)
        ):
            if isinstance(step, Epoch):
                text = f"train (loss {step.loss:.3f}, validation {step.validation_loss:.3f})"
                bar.update(task, completed=step.number, description=text)
            else:
                trained = step
    assert trained is not None  # noqa: S101 - fit ends with the network
    inputs = (ModelInput("features", parts["train"].x.shape[1:], "thesis_type2"),)
    onnx_bytes = to_onnx(trained.net, inputs)
    difference = parity(trained.net, onnx_bytes, {"features": parts["test"].x})
    if not difference <= PARITY:
        msg = f"torch and onnxruntime differ by {difference:.2g} (at most {PARITY:g} allowed)"
        raise RuntimeError(msg)
    metrics = window_metrics(onnx_bytes, trained.temperature, parts["test"])
    command = (
        f"train-export train --name {name} --elements {elements} --epochs {epochs} --seed {seed}"
    )
    bundle = BundleSpec(
        name=name,
        inputs=inputs,
        settings=settings,
        stream={
            "frame_rate_hz": (57.0, 63.0),
            "bin_length_m": (0.0034, 0.0040),
            "carrier_hz": (6.4e9, 7.4e9),
            "bandwidth_hz": (2.0e9, 2.6e9),
        },
        classes=CLASSES,
        temperature=trained.temperature,
        training={"recipe": _RECIPE, "command": command, "seed": seed},
        metrics={**metrics, "logit difference torch - onnxruntime": float(f"{difference:.1e}")},
    )
    write_bundle(out, bundle, onnx_bytes)
    tell_bundle(out / name, metrics, f" (best epoch {trained.best_epoch})")
    return 0
