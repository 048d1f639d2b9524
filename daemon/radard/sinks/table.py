"""A table for people: one line a decision, alarms and faults marked."""

import sys

from radard.output import Record

_HEAD = "    time  gate      power   floor   range  human   pet  who"
_HEAD_EVERY = 20
_BOLD, _DIM, _PLAIN = "\x1b[1;31m", "\x1b[2m", "\x1b[0m"


class TableSink:
    """Print records as lines that a person reads."""

    def __init__(self) -> None:
        self._lines = 0
        self._colour = sys.stdout.isatty()

    def write(self, record: Record) -> None:
        """As in `Sink`."""
        kind = record["type"]
        if kind == "decision":
            if self._lines % _HEAD_EVERY == 0:
                self._print(_HEAD, _DIM)
            self._lines += 1
            self._print(*_decision_line(record))
        elif kind == "event":
            what = f"{record['kind'].upper()} {record['phase']}: {record['reason']}"
            self._print(
                f"{record['t_s']:7.2f}s  {what}", _BOLD if record["phase"] == "new" else ""
            )
        elif kind == "status":
            reason = f" ({record['reason']})" if record["reason"] else ""
            self._print(f"{'':9} {record['state']}{reason}", _DIM)
        else:
            model = record["model"] or "no model, gate only"
            rate = f"{record['frame_rate_hz']:g} Hz, {record['n_range']} bins"
            self._print(f"radard {record['version']} on {record['port']} ({rate}; {model})", "")

    def close(self) -> None:
        """As in `Sink`."""
        sys.stdout.flush()

    def _print(self, text: str, style: str) -> None:
        line = f"{style}{text}{_PLAIN}" if self._colour and style else text
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


def _decision_line(record: Record) -> tuple[str, str]:
    def number(key: str, form: str, unit: str = "") -> str:
        value = record[key]
        width = int(form.partition(".")[0])
        return f"{'-':>{width + len(unit)}}" if value is None else f"{value:{form}f}{unit}"

    who = record["label"] or ""
    if record["alarm"]:
        who = f"{who}  << ALARM"
    line = (
        f"{record['t_s']:7.2f}s  {record['gate']:<7} {number('power_db', '7.1')} "
        f"{number('noise_floor_db', '7.1')}  {number('range_m', '5.2', 'm')}  "
        f"{number('fused_p_human', '5.2')} {number('fused_p_pet', '5.2')}  {who}"
    )
    return line, _BOLD if record["alarm"] else (_DIM if record["gate"] == "closed" else "")
