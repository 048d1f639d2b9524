"""`radard top`: a live view of the daemon that runs on this machine, over its control socket."""

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from radard.commands.control import asked, config_to_ask, sensors_asked, told
from radard.config.config import Config
from radard.config.options import add_options
from radard.errors import RadardError
from x2radar.command import Parser, new_parser

_EXAMPLES = """\
examples:
  radard top                   q or Ctrl-C ends it
  radard top --sensor hall     one of several
  radard top --once | less     as it is now; so too where there is no terminal

The daemon's own user and root may look: sudo -u radard radard top
"""
_EVERY_S = 0.5  # a decision comes every second
_SHADES = " ░▒▓█"
_MAX_COLUMNS = 60  # of range-time: a quarter of a minute
_MAX_DECISIONS = 8
_BAR = 24
_FUSED = ("fused_p_human", "fused_p_pet")
Answer = Mapping[str, Any]


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    config = config_to_ask(args.config)
    view = View(config, sensors_asked(config, args.sensor))
    view.look(is_first=True)
    console = Console(highlight=False)
    if args.once or not console.is_terminal:
        console.print(view.shown())
        return 0
    live = Live(view.shown(), console=console, screen=True, auto_refresh=False)
    with contextlib.suppress(KeyboardInterrupt), live as screen, _keys() as is_pressed:
        while not is_pressed("q"):
            view.look()
            screen.update(view.shown(), refresh=True)
    return 0


def make_parser() -> Parser:
    parser = new_parser("radard top", "Watch the daemon that runs here.", _EXAMPLES)
    add_options(parser, "--sensor", "--config")
    parser.add_argument("--once", action="store_true", help="as it is now, and end")
    return parser


@contextlib.contextmanager
def _keys() -> Iterator[Callable[[str], bool]]:
    """Lend what waits a moment for a key, and says whether it was that one."""
    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)

    def is_pressed(key: str) -> bool:
        ready, _, _ = select.select([fd], [], [], _EVERY_S)
        return bool(ready) and key in os.read(fd, 64).decode(errors="replace")

    tty.setcbreak(fd)
    try:
        yield is_pressed
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)


class View:
    """What is known of the sensors, and how it is shown."""

    def __init__(self, config: Config, names: Sequence[str]) -> None:
        self._config, self._names = config, names
        self._answers: dict[str, Answer] = {}
        self._faults: dict[str, str] = {}
        self._columns: dict[int, str] = {}

    def look(self, *, is_first: bool = False) -> None:
        """Ask the daemon; the first time, raises NoDaemon or NotAllowed if none answers."""
        for name in self._names:
            try:
                answer = self._answers[name] = asked(self._config, name, "look")
                self._faults.pop(name, None)
            except RadardError as err:
                if is_first:
                    raise
                self._faults[name] = str(err)
                continue
            picture = answer["picture"] or {"columns": [], "first": 0}
            new = dict(enumerate(picture["columns"], picture["first"]))
            if new and max(new) < max(self._columns, default=0):
                # The stream has begun again.
                self._columns.clear()
            self._columns = dict(sorted({**self._columns, **new}.items())[-_MAX_COLUMNS:])

    def shown(self) -> RenderableType:
        """Return what is drawn: all of one sensor, a line for each of several."""
        return self._several() if len(self._names) > 1 else Group(*self._one(self._names[0]))

    def _several(self) -> Table:
        table = _table("sensor", "sees", "person", "pet", "outputs", "state")
        for name, answer in self._answers.items():
            last = (_decisions(answer) or [{}])[-1]
            line = self._faults.get(name) or _line(answer)
            waiting = sum(each["n_waiting"] for each in answer["outputs"])
            is_well = all(each["status"] == "ok" for each in answer["outputs"])
            outputs = f"{waiting} wait" if waiting else "ok" if is_well else "in trouble"
            bars = (_bar(last.get(key), 10) for key in _FUSED)
            state = _styled(line, no_wrap=True, overflow="ellipsis")
            table.add_row(name, _sees(last), *bars, outputs, state)
        return table

    def _one(self, name: str) -> Iterator[RenderableType]:
        answer = self._answers[name]
        yield _styled(f"{name}: {self._faults.get(name) or _line(answer)}")
        for kind, reason in (answer["panel"] or {}).get("open", {}).items():
            yield _styled(f"{kind.upper()}: {reason}")
        decisions = _decisions(answer)
        last = (decisions or [{}])[-1]
        for who, key in zip(("person", "pet"), _FUSED, strict=True):
            yield f"{who:<6} {_bar(last.get(key), _BAR)}"
        yield ""
        yield from self._range_time(answer["picture"])
        table = _table("t", "gate", "range", "person", "pet", "sees")
        for each in decisions[-_MAX_DECISIONS:]:
            cells = (_percent(each[key]) for key in _FUSED)
            range_m = "" if each["range_m"] is None else f"{each['range_m']:.1f} m"
            table.add_row(f"{each['t_s']:.1f} s", each["gate"], range_m, *cells, _sees(each))
        yield table
        outputs = _table("output", "state", "sent", "wait", "dropped", "")
        for each in answer["outputs"]:
            counts = (str(each[f"n_{key}"]) for key in ("sent", "waiting", "dropped"))
            why = Text(each["reason"] or each["remark"])
            outputs.add_row(Text(each["name"]), each["status"], *counts, why)
        yield outputs

    def _range_time(self, picture: Mapping[str, Any] | None) -> Iterator[str]:
        if picture is None or not self._columns:
            return
        near_m, far_m = picture["range_m"]
        columns = list(self._columns.values())
        n_rows = len(columns[-1])
        for k in reversed(range(n_rows)):
            at_m = near_m + (k + 0.5) / n_rows * (far_m - near_m)
            yield f"{at_m:5.1f} m " + "".join(_SHADES[int(column[k])] for column in columns)
        yield f"        the last {len(columns) * picture['column_s']:.0f} s"
        yield ""


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for name in columns:
        table.add_column(name, header_style="dim", no_wrap=name not in {"", "state"})
    return table


def _styled(text: str, **how: Any) -> Text:
    """Return a text that says no more than it says: what stands in brackets is no style."""
    style = "bold red" if "ALARM" in text else "" if "online" in text else "yellow"
    return Text(text, style, **how)


def _line(answer: Answer) -> str:
    status, panel = answer["status"], answer["panel"]
    state = ": ".join(filter(None, (status["state"], status["reason"])))
    return told(state, panel) if panel else state


def _decisions(answer: Answer) -> list[Mapping[str, Any]]:
    return [record for record in answer["records"] if record["type"] == "decision"]


def _sees(decision: Mapping[str, Any]) -> str:
    return f"{decision.get('label') or ''}{' ALARM' if decision.get('alarm') else ''}"


def _percent(p: float | None) -> str:
    return "" if p is None else f"{100 * p:.0f} %"


def _bar(p: float | None, width: int) -> str:
    n = round((p or 0.0) * width)
    return f"{'█' * n}{'░' * (width - n)} {_percent(p):>5}"
