"""`train-export evaluate`: a bundle on passages it has never seen, reported like an alarm."""

import argparse
from dataclasses import asdict
from pathlib import Path

from radard.config.sections import DEFAULT_MODEL
from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from x2radar.commands import add_command
from x2train.commands import Commands, add_crew, check_least, crew_of, result_console, told
from x2train.judge.table import PassageTable
from x2train.sets.shards import read_manifest

_MAX_PET_HOURS = 10_000.0  # weeks of simulation


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "evaluate",
        "judge a bundle on simulated passages, write a report",
        "examples:\n"
        "  train-export evaluate --model balanced --out report/balanced\n"
        "  train-export evaluate --model fast --against report/balanced --out report/fast\n"
        "  train-export evaluate --model thesis --radar thesis --out report/thesis\n"
        "  train-export evaluate --only fan 'empty room' --passages 240 --out report/quiet\n"
        "  train-export evaluate --model mine.onnx --card --out report/mine\n"
        "  train-export evaluate --model auto --recordings home.csv --out report/home\n",
    )
    add = parser.add_argument
    add("--model", default=DEFAULT_MODEL, help=f"bundle by name or file ({DEFAULT_MODEL})")
    add("--out", type=Path, required=True, help="folder of passages, report.json, report.html")
    add("--passages", type=int, default=3000, help="passages of all suites together (3000)")
    add("--pet-hours", type=float, default=0.0, metavar="H", help="with pets, at least (0)")
    add("--seed", type=int, default=50, help="same seed, same passages (50)")
    add("--policy", choices=("window", "fused"), help="instead of the bundle's own")
    text = "each suite's own, or one for all; thesis: an X2 with all its bins (suites)"
    add("--radar", choices=("suites", "thesis", "x4m03", "p4xx"), default="suites", help=text)
    add("--only", nargs="+", default=[], metavar="SUITE", help="suites, by name (all)")
    text = "instead of simulated passages: a CSV or YAML file of file, start, end, label"
    add("--recordings", type=Path, metavar="LIST", help=text)
    add("--against", type=Path, metavar="DIR", help="another bundle's folder, compared")
    add("--card", action="store_true", help="enter the rates into the bundle's card")
    add_crew(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_least(args, passages=1, seed=0, workers=1)
    from x2train.bundle.writing import evaluation_of, write_card  # noqa: PLC0415
    from x2train.judge.judging import OWN_RADARS, JudgeSpec  # noqa: PLC0415
    from x2train.judge.page import passage_png  # noqa: PLC0415
    from x2train.judge.report import write  # noqa: PLC0415
    from x2train.judge.suites import n_more_pets  # noqa: PLC0415
    from x2train.sets.shards import make_shards  # noqa: PLC0415
    from x2train.sets.sites import ONE_RADAR  # noqa: PLC0415
    from x2train.sets.windows import GATE  # noqa: PLC0415

    if not 0 <= args.pet_hours <= _MAX_PET_HOURS:
        raise UsageError(f"--pet-hours {args.pet_hours:g}: must be 0 to {_MAX_PET_HOURS:g}")
    if args.recordings:
        return _run_recordings(args)
    bundle = load_bundle(args.model)
    if args.card and args.only:
        raise UsageError("--card with --only: a card tells of all suites")
    if args.card and args.policy not in {None, bundle.policy}:
        msg = f"--card with --policy {args.policy}: a card tells of the bundle's own policy"
        raise UsageError(msg)
    other: PassageTable | None = None
    if args.against:
        other = PassageTable.load(args.against / "passages")
        if (radar := read_manifest(args.against / "passages").about.get("radar")) != args.radar:
            msg = f"--against {args.against}: judged with --radar {radar}, not {args.radar}"
            raise UsageError(msg)
    spec = JudgeSpec(
        model=args.model,
        seed=args.seed,
        n_passages=args.passages,
        policy=args.policy or "",
        radar=args.radar,
        only=tuple(args.only),
    )
    spec.check(bundle)
    n_all = args.passages + n_more_pets(args.pet_hours, args.passages, args.only)
    about = {
        "kind": "passages",
        **asdict(spec),
        "judges_as": bundle.judges_as,
        "gate": GATE.model_dump(),
    }
    with crew_of(args) as crew:
        make_shards(args.out / "passages", about, n_all, spec, crew, per_shard=200)
    table = PassageTable.load(args.out / "passages")
    title = f"Bundle {bundle.name}, policy {args.policy or bundle.policy}"
    if args.radar != OWN_RADARS:
        title += f", before the {ONE_RADAR[args.radar].name}"
    write(
        table,
        args.out,
        title=title,
        other=other,
        render=lambda row: passage_png(spec, int(table.build[row])),
    )
    console = result_console()
    console.print(f"wrote {args.out / 'report.html'} and report.json")
    if args.card:
        made = evaluation_of(table, bundle, _command(args))
        console.print(f"entered the rates into {write_card(args.model, made)}")
    return 0


def _run_recordings(args: argparse.Namespace) -> int:
    from x2train.judge.judging import judge_labelled, read_list  # noqa: PLC0415
    from x2train.judge.report import write  # noqa: PLC0415

    given = [name for name in ("only", "card", "pet_hours") if getattr(args, name)]
    if given:
        msg = f"--recordings with --{given[0].replace('_', '-')}: that is of simulated passages"
        raise UsageError(msg)
    other = PassageTable.load(args.against / "passages") if args.against else None
    table = judge_labelled(read_list(args.recordings), args.model, args.policy or "")
    about = {"kind": "recordings", "model": args.model, "policy": args.policy or ""}
    table.save(args.out / "passages", {**about, "recordings": str(args.recordings)})
    title = f"Bundle {args.model} on {args.recordings.name}"
    write(table, args.out, title=title, other=other)
    result_console().print(f"wrote {args.out / 'report.html'} and report.json")
    return 0


def _command(args: argparse.Namespace) -> str:
    passages = told(args, "passages", pet_hours=0.0)
    return f"train-export evaluate {told(args, 'model', radar='suites')} {passages} " + told(
        args, "seed card"
    )
