"""`x2radar scenes` and `x2radar simulate`: what can be simulated, and a module that sends it."""

import argparse
from contextlib import closing

from x2radar.commands import Commands, add_command
from x2radar.device.transport import PtyTransport
from x2radar.errors import SettingsError
from x2radar.ports import parse_speed
from x2radar.sim.module.cost import bill
from x2radar.sim.module.faults import describe_faults, parse_faults
from x2radar.sim.module.host import serve
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import Scene, builtin_scenes, load_scene


def register(commands: Commands) -> None:
    text = "list the built-in scenes"
    add_command(commands, "scenes", text, "example:\n  x2radar scenes\n").set_defaults(run=_list)
    parser = add_command(
        commands,
        "simulate",
        "serve a simulated module on a pseudo-terminal, or say what a scene costs",
        "examples:\n"
        "  x2radar simulate --scene human --pty\n"
        "  x2radar simulate --pty --fault drop_frames:0.01,bursts:1\n"
        "  x2radar simulate --cost --scene human_behind_fan\n\n"
        "faults, with the unit of their value (seconds are module time):\n" + describe_faults(),
    )
    parser.add_argument("--scene", default="demo", help="built-in scene or YAML file (demo)")
    parser.add_argument("--seed", type=int, default=0, help="same seed, same frames (0)")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--pty", action="store_true", help="print a device path")
    what.add_argument("--cost", action="store_true", help="print what each part costs, and end")
    parser.add_argument("--speed", default="realtime", help="realtime, max or a factor")
    parser.add_argument("--fault", metavar="KIND:VALUE,...", help="what goes wrong; see below")
    parser.set_defaults(run=_serve)


def _list(_args: argparse.Namespace) -> int:
    scenes = builtin_scenes()
    width = max(len(scene.name) for scene in scenes)
    for scene in scenes:
        print(f"{scene.name:<{width}}  {scene.description}")
    return 0


def _serve(args: argparse.Namespace) -> int:
    if args.seed < 0:
        raise SettingsError(f"--seed {args.seed}: must be a whole number from 0 up")
    if args.cost:
        return _print_bill(load_scene(args.scene), args.seed)
    faults = parse_faults(args.fault) if args.fault is not None else None
    module = SimulatedModule(load_scene(args.scene), args.seed, faults)
    speed = parse_speed(args.speed)
    pty = PtyTransport()
    print(pty.path, flush=True)
    with closing(pty):
        serve(module, pty, speed=speed)
    return 0


def _print_bill(scene: Scene, seed: int) -> int:
    lines = bill(scene, seed)
    width = max(len(line.part) for line in lines)
    print(f"{scene.name}: CPU for a second of the stream on this computer")
    for line in lines:
        error = "" if line.error_db is None else f"  echoes' error {line.error_db:.0f} dB"
        print(f"{line.part:<{width}}  {line.cpu_ms:7.2f} ms{error}")
    return 0
