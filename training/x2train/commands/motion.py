"""`train-export motion import`: files of recorded or animated motion become clips."""

import argparse
import re
from pathlib import Path

from radard.errors import UsageError
from x2radar.commands import add_command
from x2train.commands import Commands, result_console

_EXAMPLE = """\
examples:
  train-export motion import walk.bvh --map mixamo.yaml --out clips --species human --who anna
  train-export motion import *.amc --map acclaim.yaml --rate 120 --out clips --species dog \\
      --who rex --licence 'CC0' --source https://example.org/rex
docs/training.md has the form of a map, and names sources of motion that are public.
"""


def register(commands: Commands) -> None:
    parser = add_command(commands, "motion", "recorded motion to make bodies of", _EXAMPLE)
    add = parser.add_argument
    add("action", choices=["import"], help="make clips of files")
    add("files", nargs="+", type=Path, metavar="FILE", help=".bvh, .amc, .gltf, .glb, .npz")
    add("--map", required=True, type=Path, metavar="YAML", help="which joint is which")
    add("--out", required=True, type=Path, metavar="DIR", help="where the clips are written")
    add("--species", required=True, help="human, or the animal: dog, cat, rabbit, ...")
    add("--who", required=True, help="the individual; clips of one individual follow each other")
    add("--licence", help="for cards of bundles that learn from it")
    add("--source", help="where it is from, for the same")
    add("--asf", type=Path, metavar="FILE", help="skeleton of .amc files (the one beside them)")
    add("--rate", type=float, default=120.0, metavar="HZ", help="frame rate of .amc files (120)")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    import numpy as np  # noqa: PLC0415

    from x2train.motion.clips import read_map, standard_clip  # noqa: PLC0415
    from x2train.motion.formats import read_motions  # noqa: PLC0415

    joint_map = read_map(args.map)
    is_person = args.species == "human"
    if is_person != (joint_map.kind == "person"):
        raise UsageError(f"--species {args.species}: the map is of kind {joint_map.kind}")
    about = {
        "species": args.species,
        "person" if is_person else "animal": args.who,
        "licence": args.licence or "",
        "source": args.source or "",
    }
    made = {}
    for file in args.files:
        for motion in read_motions(file, asf=args.asf, rate_hz=args.rate):
            stem = re.sub(r"[^\w-]+", "_", f"{args.who}_{motion.name}").strip("_")
            if stem in made or (args.out / f"{stem}.npz").exists():
                msg = f"{file}: a clip {stem}.npz is there already; name it otherwise, or --who"
                raise UsageError(msg)
            made[stem] = {**standard_clip(motion, joint_map, str(file)), "action": motion.name}
    args.out.mkdir(parents=True, exist_ok=True)
    console = result_console()
    for stem, arrays in made.items():
        path = args.out / f"{stem}.npz"
        np.savez_compressed(path, **arrays, **about)
        seconds = len(arrays["positions"]) / float(arrays["frame_rate_hz"])
        console.print(f"{path}: {seconds:.1f} s")
    return 0
