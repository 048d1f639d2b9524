"""A table for people: one line a decision, alarms and faults marked."""

from radard.sinks.base import Record

_HEAD = "    time  gate      power   floor   range  human   pet  who"
_HEAD_EVERY = 20
_BOLD, _DIM, _PLAIN = "\x1b[1;31m", "\x1b[2m", "\x1b[0m"


class Table:
    """Render records as lines that a person reads.

    Parameters
    ----------
    has_colour : bool
        Mark with colours as well.
    """

    def __init__(self, *, has_colour: bool) -> None:
        self._n_lines = 0
        self._has_colour = has_colour

    def render(self, record: Record) -> str:
        """Return the text of one record, with its line end."""
        text = self._rendered(record)
        # `hello` names its sensor always, and its port anyway.
        sensor = "" if record["type"] == "hello" else record.get("sensor", "")
        return f"{sensor:<10} {text}" if sensor else text

    def _rendered(self, record: Record) -> str:
        kind = record["type"]
        if kind == "decision":
            head = self._styled(_HEAD, _DIM) if self._n_lines % _HEAD_EVERY == 0 else ""
            self._n_lines += 1
            return head + self._styled(*_decision_line(record))
        if kind == "event":
            what = f"{record['kind'].upper()} {record['phase']}: {record['reason']}"
            style = _BOLD if record["phase"] == "new" else ""
            return self._styled(f"{record['t_s']:7.2f}s  {what}", style)
        if kind == "status":
            reason = f" ({record['reason']})" if record["reason"] else ""
            return self._styled(f"{'':9} {record['state']}{reason}", _DIM)
        model = record["model"] or "no model, gate only"
        rate = f"{record['frame_rate_hz']:g} Hz, {record['n_range']} bins"
        return f"radard {record['version']} on {record['port']} ({rate}; {model})\n"

    def _styled(self, text: str, style: str) -> str:
        return f"{style}{text}{_PLAIN}\n" if self._has_colour and style else f"{text}\n"


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
