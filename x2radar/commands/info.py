"""`x2radar ports` and `info`: where modules are; what a module or recording says of itself."""

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from x2radar.commands import Commands, add_command
from x2radar.device.device import X2Radar
from x2radar.device.discovery import list_ports, port_state
from x2radar.errors import DeviceError
from x2radar.frame import FrameCounts
from x2radar.ports import is_port, parse_port
from x2radar.radars import make_radar
from x2radar.recording.blocks import BlockReader
from x2radar.recording.registry import format_of, open_recording
from x2radar.wire.messages import GetSystemInfo, Message, Ping, Pong, Reply
from x2radar.wire.wire_ids import PONG_NAMES, InfoItem


def register(commands: Commands) -> None:
    text = "list serial ports and what is known of them"
    parser = add_command(commands, "ports", text, "example:\n  x2radar ports --probe\n")
    parser.add_argument("--probe", action="store_true", help="ping every port, one after another")
    parser.add_argument("--json", action="store_true", help="one JSON object a port")
    parser.set_defaults(run=_list)
    parser = add_command(
        commands,
        "info",
        "describe a recording or a module",
        "examples:\n  x2radar info dog.h5\n  x2radar info /dev/ttyACM0 --json\n",
    )
    parser.add_argument("what", metavar="FILE|PORT", help="recording, device, URL or sim:SCENE")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_describe)


def _list(args: argparse.Namespace) -> int:
    rows = list_ports()
    if not rows and not args.json:
        print("no serial ports")
    for row in rows:
        is_module, state = port_state(row.path) if args.probe else (None, None)
        if args.json:
            print(json.dumps({**asdict(row), "is_module": is_module, "state": state}))
            continue
        known = f"{row.known} ({row.known_from})" if row.known else ""
        maker = f"{row.manufacturer} {row.product}".strip()
        parts = (row.path, state, row.usb_id, maker, row.serial_number, known, row.by_id)
        print("  ".join(part for part in parts if part))
    return 0


def _describe(args: argparse.Namespace) -> int:
    if is_port(args.what):
        facts = _ask(args.what)
        shown = {"port": facts["port"], "ping": facts["ping"], **facts["info"]}
        rows = {**shown, **facts["settings"]}.items()
        lines = [f"{name.replace('_', ' '):<16} {value}" for name, value in rows]
    else:
        facts = describe_recording(Path(args.what.removeprefix("replay:")))
        lines = [f"{name:<11}{text}" for name, text in _summary(facts).items()]
    print(json.dumps(facts, default=str) if args.json else "\n".join(lines))
    return 0


def _ask(port: str) -> dict[str, Any]:
    """Open a module, ask for everything it has an item for, and close it."""
    with make_radar(parse_port(port)) as radar:
        answers = dict(answers_of(radar))
    pong = answers.pop("ping")
    values = {name: reply.value for name, reply in answers.items() if isinstance(reply, Reply)}
    return {
        "port": port,
        "ping": PONG_NAMES.get(pong.code, pong.code) if isinstance(pong, Pong) else None,
        "info": {name: v if isinstance(v, str) else list(v) for name, v in values.items()},
        "settings": asdict(radar.settings),
    }


def answers_of(radar: X2Radar, wait_s: float | None = None) -> Iterator[tuple[str, Message | str]]:
    """Yield what a module says to a ping and to each `InfoItem`; old firmware lacks items."""
    items = ((item.name.lower(), GetSystemInfo(item)) for item in InfoItem)
    for name, command in (("ping", Ping()), *items):
        try:
            yield name, radar.command(command, wait_s=wait_s)
        except DeviceError as err:
            yield name, "no answer" if "no answer" in str(err) else "refused"


def describe_recording(path: Path) -> dict[str, Any]:
    """Return facts about a recording, JSON-safe, of counters and times, not samples."""
    with open_recording(path) as reader:
        axis = asdict(reader.stream.axis)
        axis["range_m"] = [float(reader.stream.axis.range_m[k]) for k in (0, -1)]
        whole = path.iterdir() if path.is_dir() else format_of(path).files(path)
        files = reader.paths or whole
        return {
            "path": str(path),
            "format": format_of(path).name,
            "kind": axis.pop("kind"),
            **_counted(reader),
            "axis": axis,
            "started_utc": reader.started_utc,
            "device": dict(reader.device),
            "settings": dict(reader.settings),
            "labels": [list(label) for label in reader.labels],
            "has_decisions": reader.has_decisions,
            "compression": reader.compression,
            "n_bytes": sum(file.stat().st_size for file in files if file.is_file()),
            "parts": [str(part) for part in reader.paths],
            "warning": reader.warning,
        }


def _counted(reader: BlockReader) -> dict[str, Any]:
    counts = FrameCounts()
    counters, times_s = reader.lists()
    for counter in counters.tolist():
        counts.add(counter)
    losses = ("lost", "gaps", "longest_gap", "restarts", "repeats")
    span_s, index = float(times_s[-1] - times_s[0]), counts.tracker.index
    return {
        "n_frames": counts.n_frames,
        "duration_s": span_s + 1 / reader.stream.frame_rate_hz,
        "frame_rate_hz": reader.stream.frame_rate_hz,
        "measured_rate_hz": index / span_s if span_s > 0 and index > 0 else None,
        **{name: getattr(counts, name) for name in losses},
    }


def _summary(facts: dict[str, Any]) -> dict[str, str]:
    """Return the facts of `describe_recording` as rows for people."""
    axis, device = facts["axis"], facts["device"]
    low_m, high_m = axis["range_m"]
    measured, sampler_hz = facts["measured_rate_hz"], axis["sample_rate_hz"]
    labels = sorted({label for _, _, label in facts["labels"]})
    return {
        "format": f"{facts['format']}, {facts['kind']}",
        "frames": f"{facts['n_frames']}, {facts['duration_s']:.3f} s",
        "frame rate": f"{facts['frame_rate_hz']:.6g} Hz stated, "
        + (f"{measured:.6g} Hz measured" if measured else "not measurable"),
        "losses": f"{facts['lost']} frames in {facts['gaps']} gaps, longest "
        f"{facts['longest_gap']}; {facts['restarts']} restarts, {facts['repeats']} repeats",
        "range": f"{low_m:.3f} to {high_m:.3f} m, {axis['n_range']} bins of "
        f"{axis['bin_length_m'] * 1e3:.3f} mm",
        "pulse": f"{axis['carrier_hz'] / 1e9:g} GHz, bandwidth "
        + (f"{axis['bandwidth_hz'] / 1e9:g} GHz" if axis["bandwidth_hz"] else "unknown"),
        "sampler": f"{sampler_hz / 1e9:g} GS/s" if sampler_hz else "unknown",
        "started": facts["started_utc"] or "unknown",
        "device": device.get("name", "unknown"),
        "labels": f"{len(facts['labels'])} ({', '.join(labels)})" if labels else "none",
        "decisions": "present" if facts["has_decisions"] else "none",
        "size": f"{facts['n_bytes'] / 1e6:.3f} MB, compression {facts['compression']}"
        + (f", {len(facts['parts'])} parts" if facts["parts"] else ""),
        "warning": facts["warning"] or "none",
    }
