"""`train-export dataset`: windows of random passages, as shards."""

import argparse
from dataclasses import asdict
from pathlib import Path

from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.features import MAP_FEATURES, FeatureSettings
from radard.judge.installation import INSTALLATION
from x2radar.commands import add_command
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.skins import SKINS
from x2train.commands import Commands, add_crew, check_least, crew_of, result_console

FEATURES = FeatureSettings(
    clutter="removed",
    range_decimation=8,
    n_cpi=0,
    velocity_cpi_s=0.2,
    velocity_cpi_carrier_hz=7e9,
    velocity_cpi_frames=6,
    long_sampling=1.0,
    cell_m=0.05,
    range_window="target",
)
"""How the maps of the shipped bundles are made."""
_SHORTEST_S, _LONGEST_S = 2.0, 600.0  # a dwell; and ten minutes
_SHARES = {
    "physical": "with cross sections that follow from sizes",
    "plain": "without domain randomization",
    "clear": "of one body that goes, in a room without multipath",
    "slow": "whose recorded bodies go at a quarter to three quarters of their tempo",
}


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "dataset",
        "simulate passages into shards of windows",
        "examples:\n"
        "  train-export dataset --out sets/train --passages 24000\n"
        "  train-export dataset --out sets/big --passages 1000000 --cluster tcp://host:8786\n"
        "  train-export dataset --out sets/guard --families 'held out' --like accurate\n"
        "  train-export dataset --out sets/laws --motion gait footfalls angles \\\n"
        "      --skin surface points ellipsoids capsules --physical 0.5\n"
        "  train-export dataset --out sets/pendulum --families pendulum --passages 2000\n",
    )
    add = parser.add_argument
    add("--out", type=Path, required=True, help="folder of the set; what is there is kept")
    add("--passages", type=int, default=24_000, help="passages to simulate (24000)")
    who = "train, staying (in place), things (nobody), held out, thesis, all, or a plug-in's body"
    add("--families", metavar="USE", default="train", help=f"who moves: {who} (train)")
    text = "a folder of recorded motion, whose bodies come instead; see train-export motion"
    add("--clips", type=Path, metavar="DIR", help=text)
    add("--rooms", choices=("usual", "unseen"), default="usual", help="where")
    add("--radar", choices=("any", "x2", "x4m03"), default="any", help="with which radar (any)")
    text = "bodies are there for 2 s to so long (6); temporal heads learn from long ones"
    add("--longest", metavar="SECONDS", type=float, default=6.0, help=text)
    add("--motion", nargs="+", choices=MOTIONS, default=["gait"], help="generators (gait)")
    add("--skin", nargs="+", choices=tuple(SKINS), default=["surface"], help="echoes (surface)")
    for name, who in _SHARES.items():
        text = f"of passages {who}, 0 to 1 (0)"
        add(f"--{name}", metavar="SHARE", type=float, default=0.0, help=text)
    add("--like", metavar="MODEL", help="maps as this bundle takes them, for finetune --guard")
    add("--seed", type=int, default=1, help="same seed, same set (1)")
    add_crew(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_least(args, passages=1, seed=0, workers=1)
    if not _SHORTEST_S <= args.longest <= _LONGEST_S:
        msg = f"--longest {args.longest:g}: must be {_SHORTEST_S:g} to {_LONGEST_S:g} s"
        raise UsageError(msg)
    for name in _SHARES:
        if not 0.0 <= getattr(args, name) <= 1.0:
            raise UsageError(f"--{name} {getattr(args, name):g}: must be 0 to 1")
    if args.slow and not args.clips:
        raise UsageError("--slow: is of recorded bodies, --clips")
    from x2train.motion.library import cards_of, read_library  # noqa: PLC0415
    from x2train.sets.families import CLIPS, USES, plugged_family  # noqa: PLC0415
    from x2train.sets.shards import make_shards  # noqa: PLC0415
    from x2train.sets.windows import GATE, WindowSpec  # noqa: PLC0415

    use, learned_from = args.families, {}
    if args.clips:
        use = f"{CLIPS}{args.clips.resolve()}"
        # What the set is made of, wherever the folder lies.
        learned_from = {"use": "clips", "clips": cards_of(read_library(args.clips.resolve()))}
    elif use not in USES:
        plugged_family(use)
    settings = FEATURES
    if args.like:
        bundle = load_bundle(args.like)
        if not {i.feature for i in bundle.inputs} <= {*MAP_FEATURES, INSTALLATION}:
            taken, held = ", ".join(i.feature for i in bundle.inputs), ", ".join(MAP_FEATURES)
            raise UsageError(f"--like {args.like}: it takes {taken}; sets hold {held}")
        settings = bundle.features
    spec = WindowSpec(
        seed=args.seed,
        use=use,
        rooms=args.rooms,
        radar=args.radar,
        longest_s=args.longest,
        motions=tuple(args.motion),
        skins=tuple(args.skin),
        **{f"{name}_share": getattr(args, name) for name in _SHARES},
        settings=settings,
    )
    about = {"kind": "windows", **asdict(spec), **learned_from, "gate": GATE.model_dump()}
    with crew_of(args) as crew:
        shards = make_shards(args.out, about, args.passages, spec, crew)
    n = sum(len(shards.read(name).get("label", ())) for name in shards.names())
    result_console().print(f"{args.out}: {n} windows of {args.passages} passages")
    return 0
