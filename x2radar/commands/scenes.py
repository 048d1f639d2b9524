"""`x2radar scenes`: list what can be simulated."""

import argparse

from x2radar.commands import Commands, add_command
from x2radar.sim.scene.scene import builtin_scenes


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands,
        "scenes",
        "list the built-in scenes",
        "example:\n  x2radar scenes\n",
    )
    parser.set_defaults(run=_run)


def _run(_args: argparse.Namespace) -> int:
    scenes = builtin_scenes()
    width = max(len(scene.name) for scene in scenes)
    for scene in scenes:
        print(f"{scene.name:<{width}}  {scene.description}")
    return 0
