"""`radard fleet`: all radars that publish to one MQTT broker, in one table."""

import json
import queue
import sys
import time
import uuid
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from radard.config.config import Config, load_config
from radard.config.options import LONGEST_S, check_limits
from radard.errors import OutputError, UsageError
from x2radar.command import Parser, new_parser

_EXAMPLES = """\
examples:
  radard fleet mqtt://broker.lan       a table, every two seconds; Ctrl-C ends it
  radard fleet --once                  once, at the configuration's own broker
  radard fleet mqtts://me@broker.lan --once --json | jq 'select(.alarm)'
"""
_SETTLE_S = 2.0  # until what a broker keeps has come: no broker takes longer to begin with it
_EVERY_S = 2.0  # a person looks
_TOPICS = ("availability", "state", "health")
_MAX_SHOWN = 48  # characters of a reason


class Fleet:
    """What the messages of a broker say of its radars; see `radard.outputs.mqtt.topics`."""

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._told: dict[str, dict[str, Any]] = {}

    def take(self, topic: str, payload: bytes, now_s: float) -> None:
        """Take a message that came at a monotonic time; what is none of ours is left out."""
        head, _, kind = topic.rpartition("/")
        name = head.removeprefix(f"{self._prefix}/")
        if kind not in _TOPICS or not name or "/" in name or name != _plain(name):
            return
        if not payload:
            # Somebody has removed it from the broker.
            self._told.pop(name, None)
            return
        try:
            content: Any = payload.decode() if kind == "availability" else json.loads(payload)
        except (ValueError, RecursionError):
            content = None
        if not isinstance(content, str if kind == "availability" else dict):
            return
        self._told.setdefault(name, {}).update({kind: content, f"{kind}_at_s": now_s})

    def rows(self, now_s: float) -> list[dict[str, Any]]:
        """Return a row for each radar: alarms first, then those in trouble, then by name."""
        rows = [self._row(name, told, now_s) for name, told in self._told.items()]

        def rank(row: dict[str, Any]) -> tuple[int, str]:
            is_bad = row["state"] != "online" or row["tamper"] or row["fault"]
            return 0 if row["alarm"] else 1 if is_bad else 2, row["sensor"]

        return sorted(rows, key=rank)

    def _row(self, name: str, told: Mapping[str, Any], now_s: float) -> dict[str, Any]:
        # A radar that is not available is offline whatever it said.
        health, state = told.get("health", {}), told.get("state", {})
        is_on, armed = told.get("availability") == "online", state.get("armed")
        sees = "nobody" if state.get("gate") == "closed" else _plain(state.get("label")) or None
        return {
            "sensor": name,
            "state": (_plain(health.get("state")) if is_on else "") or "offline",
            "armed": armed if is_on and isinstance(armed, bool) else None,
            "alarm": bool(state.get("alarm")) and is_on,
            "sees": sees if is_on else None,
            "fault": _plain(health.get("fault")) or None,
            "tamper": _plain(health.get("tamper")) or None,
            "reason": _plain(health.get("reason")),
            "age_s": round(now_s - told["state_at_s"], 1) if "state" in told else None,
        }


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    config = load_config(args.config)
    url = args.url or config.named_output("mqtt", "mqtts")
    if url is None:
        raise UsageError("no broker: give mqtt://HOST, or an output mqtt: in the configuration")
    check_limits(args, wait=(0.001, LONGEST_S))
    with closing(_looks(url, config, args.wait)) as looks:
        while True:
            rows = next(looks)
            lines = [json.dumps(row) for row in rows] if args.json else list(table(rows))
            if not args.once and sys.stdout.isatty():
                # To the top left, and nothing below.
                print("\x1b[H\x1b[2J", end="")
            print(*lines, sep="\n", flush=True)
            if args.once:
                return 0 if rows and all(row["state"] == "online" for row in rows) else 1


def make_parser() -> Parser:
    parser = new_parser(
        "radard fleet",
        "Show all radars that publish to an MQTT broker. With --once the exit code is 0 if all "
        "are online.",
        _EXAMPLES,
    )
    add = parser.add_argument
    add("url", nargs="?", metavar="mqtt://HOST/PREFIX", help="as -o takes it; else the config's")
    add("--once", action="store_true", help="once, instead of again and again")
    add("--json", action="store_true", help="one JSON object a radar")
    add("--wait", type=float, default=_SETTLE_S, metavar="S", help="for messages (2)")
    add("--config", type=Path, metavar="FILE", help="whose mqtt section holds")
    return parser


def table(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the lines of a table for people."""
    n_alarms = sum(row["alarm"] for row in rows)
    n_well = sum(row["state"] == "online" for row in rows)
    yield f"{len(rows)} radars, {n_well} online, {n_alarms} with an alarm"
    if not rows:
        return
    width = max(6, *(len(row["sensor"]) for row in rows))
    yield f"{'sensor':<{width}}  {'state':<8}  {'armed':<8}  {'sees':<8}  {'age':>5}  remarks"
    for row in rows:
        armed = {True: "armed", False: "disarmed", None: "-"}[row["armed"]]
        age = "-" if row["age_s"] is None else f"{row['age_s']:.0f} s"
        sees = "ALARM" if row["alarm"] else row["sees"] or "-"
        remarks = [f"{kind}: {row[kind]}" for kind in ("tamper", "fault") if row[kind]]
        if not remarks and row["state"] != "online":
            remarks = [row["reason"] or "no connection"]
        text = "; ".join(remarks)[:_MAX_SHOWN]
        line = f"{row['sensor']:<{width}}  {row['state']:<8}  {armed:<8}  {sees:<8}  {age:>5}"
        yield f"{line}  {text}".rstrip()


def _looks(url: str, config: Config, wait_s: float) -> Generator[list[dict[str, Any]], None, None]:
    """Connect to a broker, listen and yield rows, again and again; OutputError if it goes."""
    # Late: the help must not wait for it, and it may not be installed.
    from radard.outputs.mqtt.link import MqttLink  # noqa: PLC0415
    from radard.outputs.mqtt.sink import parse_url  # noqa: PLC0415
    from x2radar.backoff import Backoff  # noqa: PLC0415

    # Another client of the same name would be thrown out.
    name = f"radard-fleet-{uuid.uuid4().hex[:8]}"
    options = config.mqtt.model_copy(update={"client_id": name})
    broker, prefix = parse_url(url, options, "fleet")
    fleet = Fleet(prefix)
    messages: queue.SimpleQueue[Any] = queue.SimpleQueue()  # of topic and payload; or a fault
    link = MqttLink(
        broker,
        options,
        Backoff(1.0, 10.0, broker.client_id),
        will=None,
        subscriptions=[f"{prefix}/+/{name}" for name in _TOPICS],
        on_up=lambda: messages.put(None),
        on_down=messages.put,
        on_message=lambda topic, payload, _is_retained: messages.put((topic, payload)),
        is_alive=lambda: True,
    )

    def take(item: tuple[str, bytes] | str | None) -> None:
        if isinstance(item, str):
            raise OutputError(f"mqtt {broker.host}:{broker.port}: {item}")
        if item is not None:
            fleet.take(*item, time.monotonic())

    link.start()
    try:
        take(messages.get())
        while True:
            end_s = time.monotonic() + wait_s
            with suppress(queue.Empty):
                while (left_s := end_s - time.monotonic()) > 0:
                    take(messages.get(timeout=left_s))
            yield fleet.rows(time.monotonic())
            wait_s = _EVERY_S
    finally:
        link.close(0.5)


def _plain(value: object) -> str:
    """Return a stranger's value as a text that steers no terminal; empty for none."""
    text = "" if value is None else str(value)
    return "".join(letter if letter.isprintable() else "?" for letter in text)
