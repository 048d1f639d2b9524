"""`train-export evaluate`: a bundle on passages it has never seen, reported like an alarm."""

import argparse
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from radard.classifier import Bundle, load_bundle
from radard.errors import UsageError
from x2train.commands import Commands


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "evaluate",
        help="judge a bundle on simulated passages, write a report",
        epilog=(
            "examples:\n"
            "  train-export evaluate --model balanced --out report/balanced\n"
            "  train-export evaluate --model fast --against report/balanced --out report/fast\n"
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--model", default="balanced", help="bundle by name or file (balanced)")
    add("--out", type=Path, required=True, help="folder of passages, report.json, report.html")
    add("--passages", type=int, default=3000, help="passages of all suites together (3000)")
    add("--seed", type=int, default=50, help="same seed, same passages (50)")
    add("--policy", choices=("window", "fused"), help="instead of the bundle's own")
    add("--against", type=Path, metavar="DIR", help="another bundle's folder, compared")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes (all cores)")
    add("--cluster", metavar="ADDRESS", help="a Dask scheduler, instead of processes")
    parser.set_defaults(run=_run)


def _told_by(bundle: Bundle) -> dict[str, Any]:
    """Return what of a bundle, beside its name, the decisions depend on."""
    return {
        "onnx_sha256": bundle.sha256,
        "features": asdict(bundle.features),
        "temperature": bundle.temperature,
        "pet_limit": bundle.pet_limit,
        "bundle_policy": bundle.policy,
        "evidence": dict(bundle.evidence),
    }


def _run(args: argparse.Namespace) -> int:
    for name, least in (("passages", 1), ("seed", 0), ("workers", 1)):
        if getattr(args, name) < least:
            msg = f"--{name} {getattr(args, name)}: must be at least {least}"
            raise UsageError(msg)
    # Late: the simulator takes a second, and --help must not.
    from x2train.farm import ProgressLine, make_shards  # noqa: PLC0415
    from x2train.judging import JudgeSpec  # noqa: PLC0415
    from x2train.pictures import passage_png  # noqa: PLC0415
    from x2train.report import PassageTable, write  # noqa: PLC0415

    bundle = load_bundle(args.model)
    other = PassageTable.load(args.against / "passages") if args.against else None
    spec = JudgeSpec(
        model=args.model, seed=args.seed, n_passages=args.passages, policy=args.policy or ""
    )
    make_shards(
        args.out / "passages",
        {"kind": "passages", **asdict(spec), **_told_by(bundle)},
        args.passages,
        spec,
        per_shard=200,
        workers=args.workers,
        cluster=args.cluster,
        report=ProgressLine("passages"),
    )
    table = PassageTable.load(args.out / "passages")
    title = f"Bundle {bundle.name}, policy {args.policy or bundle.policy}"
    write(
        table,
        args.out,
        title=title,
        other=other,
        render=lambda row: passage_png(spec, int(table[row].build)),
    )
    Console().print(f"wrote {args.out / 'report.html'} and report.json")
    return 0
