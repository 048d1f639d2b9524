"""`train-export leave-one-out`: networks trained without a motion or a skin, judged on it."""

import argparse
import json
from pathlib import Path

from x2radar.commands import add_command
from x2train.commands import Commands, check_least, followed, result_console


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands,
        "leave-one-out",
        "train without each motion and skin in turn, judge on it",
        (
            "example:\n"
            "  train-export dataset --out sets/laws --motion gait footfalls angles \\\n"
            "      --skin surface points ellipsoids capsules --passages 20000\n"
            "  train-export leave-one-out --sets sets/laws --epochs 8 --out left-out.json\n"
        ),
    )
    add = parser.add_argument
    add("--sets", type=Path, nargs="+", required=True, help="sets with several motions and skins")
    add("--epochs", type=int, default=8, help="passes over the windows (8)")
    add("--seed", type=int, default=0, help="same seed, same figures (0)")
    add("--out", type=Path, metavar="FILE", help="JSON; what it holds is not done again")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_least(args, epochs=1, seed=0)
    # Late: torch takes seconds, and --help must not.
    from radard.config.atomic import write_atomically  # noqa: PLC0415
    from research.leave_one_out.measure import auc_on, laws_of, trained  # noqa: PLC0415
    from x2train.sets.window_set import load_windows  # noqa: PLC0415

    windows, _ = load_windows(*args.sets)
    known: dict[str, dict[str, float | None]] = {}
    if args.out and args.out.exists():
        known = json.loads(args.out.read_text(encoding="utf-8"))
    console = result_console()
    for law in (None, *laws_of(windows)):
        name = str(law) if law else "nothing"
        if name not in known:
            net = followed(trained(windows, law, args.epochs, args.seed), args.epochs)
            known[name] = {str(k): auc_on(net, windows, k) for k in laws_of(windows)}
            if args.out:
                write_atomically(args.out, json.dumps(known, indent=1).encode())
        told = [
            f"{key} {'-' if auc is None else f'{auc:.3f}'}" for key, auc in known[name].items()
        ]
        console.print(f"without {name}: {', '.join(told)}")
    return 0
