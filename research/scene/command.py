"""`train-export scene`: draw a scene, so that a person can judge it by eye."""

import argparse
from pathlib import Path

from radard.errors import UsageError
from x2radar.commands import add_command
from x2radar.modules.modules import MODULES
from x2radar.ports import Port
from x2radar.radars import port_settings
from x2radar.sim.scene.scene import load_scene
from x2train.commands import Commands, result_console


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands,
        "scene",
        "draw a scene: range, velocity, spectrogram, from above",
        "example:\n  train-export scene human --plot human.png --seed 3\n",
    )
    add = parser.add_argument
    add("name", help="built-in scene (x2radar scenes) or YAML file")
    add("--plot", type=Path, required=True, metavar="FILE", help="picture to make")
    add("--seed", type=int, default=0, help="same seed, same scene (0)")
    add("--duration", type=float, default=12.0, metavar="S", help="seconds (12)")
    add("--rate", type=float, default=60.0, metavar="HZ", help="frames per second (60)")
    add("--device", default="x2raw", help=f"{', '.join(MODULES)} (x2raw)")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    # Late: matplotlib takes a second, and --help must not.
    from research.scene.plot import plot_scene  # noqa: PLC0415

    if not 2 <= args.duration <= 3600:
        msg = f"--duration {args.duration:g}: must be 2 to 3600 seconds"
        raise UsageError(msg)
    if args.seed < 0:
        msg = f"--seed {args.seed}: must be 0 or more"
        raise UsageError(msg)
    if args.plot.suffix not in {".png", ".pdf", ".svg"}:
        msg = f"--plot {args.plot}: must end in .png, .pdf or .svg"
        raise UsageError(msg)
    scene = load_scene(args.name)
    keys = {"device": args.device, "rate": f"{args.rate:g}", "kind": "baseband"}
    settings = port_settings(Port("sim", args.name, keys))
    assert not callable(settings)  # noqa: S101 - only device=auto needs a module
    made = plot_scene(scene, args.seed, settings, args.duration, args.plot)
    result_console().print(str(made))
    return 0
