"""`x2radar info`: what a recording holds, or what a module says about itself."""

import argparse
import json
from dataclasses import asdict
from typing import Any

from x2radar.commands import Commands, add_command
from x2radar.device.device import X2Radar
from x2radar.errors import DeviceError
from x2radar.ports import is_port, parse_port, recording_path
from x2radar.radars import make_radar
from x2radar.wire.messages import GetSystemInfo, Message, Ping, Pong, Reply
from x2radar.wire.wire_ids import InfoItem, PongCode


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands,
        "info",
        "describe a recording or a module",
        "examples:\n  x2radar info dog.h5\n  x2radar info /dev/ttyACM0 --json\n",
    )
    parser.add_argument("what", metavar="FILE|PORT", help="recording, device, URL or sim:SCENE")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    if is_port(args.what):
        facts = _ask(args.what)
        lines = _port_lines(facts)
    else:
        # Late: h5py takes a while, and a port does without.
        from x2radar.recording.info import describe_recording, summary  # noqa: PLC0415

        facts = describe_recording(recording_path(args.what))
        lines = summary(facts)
    print(json.dumps(facts, default=str) if args.json else "\n".join(lines))
    return 0


def _ask(port: str) -> dict[str, Any]:
    """Open a module, ask for everything it has an item for, and close it."""
    with make_radar(parse_port(port)) as radar:
        pong = _answer(radar, Ping())
        items = {}
        for item in InfoItem:
            reply = _answer(radar, GetSystemInfo(item))
            if isinstance(reply, Reply):
                items[item.name.lower()] = _plain(reply.value)
    code = pong.code if isinstance(pong, Pong) else None
    known = code in set(PongCode)
    return {
        "port": port,
        "ping": PongCode(code).name.lower() if known and code is not None else code,
        "info": items,
        "settings": asdict(radar.settings),
    }


def _answer(radar: X2Radar, command: Message) -> Message | None:
    """Return the reply, or None where the module refuses: old firmware lacks items."""
    try:
        return radar.command(command)
    except DeviceError:
        return None


def _plain(value: str | tuple[int, ...] | tuple[float, ...]) -> Any:
    return value.rstrip("\0") if isinstance(value, str) else list(value)


def _port_lines(facts: dict[str, Any]) -> list[str]:
    rows = {"port": facts["port"], "ping": facts["ping"], **facts["info"]}
    lines = [f"{name.replace('_', ' '):<16} {value}" for name, value in rows.items()]
    settings = facts["settings"].items()
    return [*lines, *(f"{name.replace('_', ' '):<16} {value}" for name, value in settings)]
