"""`train-export accept`: the acceptance test of a product, entry by entry."""

import argparse
from pathlib import Path
from typing import Any

from radard.config.sections import AUTO_MODEL
from radard.errors import UsageError
from x2radar.commands import add_command
from x2train.commands import Commands, add_crew, check_least, crew_of, result_console


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "accept",
        "the acceptance test of a product: what a buyer asks, entry by entry",
        "examples:\n"
        "  train-export accept --out accept/shipped              twenty minutes of one core\n"
        "  train-export accept --share 0.1 --out accept/short    a tenth of every entry\n"
        "  train-export accept --model mine.onnx --out accept/mine\n"
        "  train-export accept --level --out accept/level        as after a walk test\n"
        "  train-export accept --clips clips --out accept/clips  bodies that were recorded\n"
        "\n"
        "A run that was interrupted goes on where it stopped; the number of workers changes\n"
        "nothing.\n",
    )
    add = parser.add_argument
    add("--model", default=AUTO_MODEL, help=f"bundle by name or file; by radar ({AUTO_MODEL})")
    add("--level", action="store_true", help="mount and level known, as after `radard walktest`")
    text = "recorded people and animals instead, of clips that the bundle has not learned from"
    add("--clips", type=Path, metavar="DIR", help=text)
    add("--out", type=Path, required=True, help="folder: passages, acceptance.json and .html")
    add("--share", type=float, default=1.0, metavar="F", help="of every entry's passages (1)")
    add("--seed", type=int, default=90, help="same seed, same passages (90)")
    add_crew(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_least(args, seed=0, workers=1)
    if not 0 < args.share <= 1:
        raise UsageError(f"--share {args.share:g}: must be above 0, and 1 at most")
    from x2train.judge.acceptance import AcceptSpec, accept  # noqa: PLC0415
    from x2train.judge.acceptance_report import lines, write_acceptance  # noqa: PLC0415
    from x2train.judge.judging import Knows  # noqa: PLC0415

    knows: Knows = "mount and level" if args.level else "nothing"
    clips = str(args.clips.resolve()) if args.clips else ""
    spec = AcceptSpec(model=args.model, seed=args.seed, share=args.share, knows=knows, clips=clips)
    with crew_of(args) as crew:
        table = accept(spec, args.out / "passages", crew)
    new = spec.new_clips
    told = f", which move as {len(new)} clips that taught none of the bundles," if new else ""
    about: dict[str, Any] = {
        "version": spec.version,
        "bundle": " and ".join(spec.files),
        "share": args.share,
        "seed": args.seed,
        "knows": knows,
        **({"clips": new} if new else {}),
        "words": (
            f"{spec.version}: {args.share:.0%} of every entry's passages, seed {args.seed}; "
            f"simulated bodies of physical sizes{told} before "
            + ", ".join(s.name for s in spec.settings)
            + f"; the installation knows {knows}. Intervals hold 95 %."
        ),
    }
    made = write_acceptance(table, args.out, about, spec.entries)
    console = result_console()
    console.print(f"{spec.version}, a share of {args.share:g}")
    for name, counted_as, of, own, window in lines(made):
        console.print(f"{name}: {counted_as}, {of}: {own}; by single windows {window}")
    console.print(f"wrote {args.out / 'acceptance.html'} and acceptance.json")
    return 0
