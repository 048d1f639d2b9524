"""`radard events`: list alarms, faults and tampering from a store."""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from radard.config.config import load_config
from radard.config.directories import log_path
from radard.config.options import check_limits
from radard.config.sink_table import KINDS, named_file
from radard.errors import UsageError
from radard.log_file import StoredEvent, newest_events, parse_since, read_events
from x2radar import wall_clock
from x2radar.command import Parser, new_parser

_ABOUT = "List the events that the log, or -o store:FILE, has kept."
_EXAMPLES = """\
examples:
  radard events                        from the store, or the daemon's log
  radard events --store /var/lib/radard/radard.db --since 24h
  radard events --kind alarm --limit 10 --json
"""


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    check_limits(args, limit=(1, math.inf))
    path = args.store or _configured(args.config)
    since_s = parse_since(args.since, wall_clock.now_s()) if args.since else None
    events = newest_events(read_events(path), since_s=since_s, kinds=args.kind, limit=args.limit)
    for line in (json.dumps(asdict(e)) for e in events) if args.json else _table(events):
        print(line)
    return 0


def make_parser() -> Parser:
    parser = new_parser("radard events", _ABOUT, _EXAMPLES)
    add = parser.add_argument
    add("--store", type=Path, metavar="FILE", help="the file of -o store:FILE")
    add("--since", metavar="WHEN", help="30min, 24h, 7d, or a date; all without it")
    add("--kind", action="append", default=[], choices=KINDS, help="only this kind; repeatable")
    add("--limit", type=int, metavar="N", help="the newest N only")
    add("--json", action="store_true", help="one JSON object an event")
    add("--config", type=Path, metavar="FILE", help="whose outputs name the store")
    return parser


def _configured(file: Path | None) -> Path:
    config = load_config(file)
    if (store := config.named_output("store")) is not None:
        return named_file(store)
    own = log_path(config)
    if own is not None and own.is_file():
        return own
    raise UsageError("no store: give --store FILE, or an output store:FILE in the configuration")


def _table(events: Sequence[StoredEvent]) -> Iterator[str]:
    if not events:
        yield "no events"
        return
    yield f"{'began (UTC)':<20} {'kind':<7} {'lasted':>8} {'peak':>5}  {'reason':<32} id"
    for e in events:
        lasted = "-" if e.lasted_s is None else f"{e.lasted_s:.0f} s"
        began = e.start_time[:19].replace("T", " ")
        mark = f"  {e.mark}" if e.mark else ""
        peak = f"{e.peak:.2f}" if e.kind == "alarm" else "-"
        yield f"{began:<20} {e.kind:<7} {lasted:>8} {peak:>5}  {e.reason:<32} {e.id}{mark}"
