"""The acceptance test's report: misses and alarms entry by entry, as JSON and as a page.

Each entry is judged by the bundle's own policy, as the daemon did, and by the thesis' rule, which
is policy `window`: an alarm unless one window's p(pet) + p(other) is over 0.8 and one of them at
least a half. Intervals are those of `x2train.judge.estimates`.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader
from numpy.typing import NDArray

from radard.judge.decision import MIN_P
from x2train.judge.acceptance import ENTRIES, Entry
from x2train.judge.estimates import per_hour, share
from x2train.judge.report import write_files
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import PET_LIMIT, hours, verdicts

_POLICIES = ("bundle", "window")  # the bundle's own policy, and the thesis' rule
_Alarms = NDArray[np.bool_]
_WORDS = {
    "walk test": ("missed", "of those in view"),
    "pets cross": ("with an alarm", "of all"),
    "pets stay": ("minutes with an alarm", "an hour"),
    "thing": ("minutes with an alarm", "an hour"),
}


def alarms_by_window(table: PassageTable) -> _Alarms:
    """Return the verdicts of policy `window` at 0.8, per decision."""
    quiet = table.p_pet + table.p_other
    most = np.maximum(table.p_pet, table.p_other)
    judged = table.is_open & np.isfinite(quiet)
    return np.asarray(judged & ~((quiet > PET_LIMIT) & (most >= MIN_P)), np.bool_)


def document(
    table: PassageTable, about: Mapping[str, Any], entries: Sequence[Entry] = ENTRIES
) -> dict[str, Any]:
    """Return the report's content: `about`, and every entry with what each policy did."""
    alarms = {"bundle": table.is_alarm, "window": alarms_by_window(table)}
    rows = []
    for entry in entries:
        chosen = table.suite == entry.name
        row = {"name": entry.name, "kind": entry.kind, **_figures(table, entry, chosen, alarms)}
        row["settings"] = {
            name: _figures(table, entry, chosen & (table.split == name), alarms)
            for name in dict.fromkeys(table.split[chosen].tolist())
        }
        rows.append(row)
    return {**about, "entries": rows}


def _figures(
    table: PassageTable, entry: Entry, chosen: _Alarms, alarms: Mapping[str, _Alarms]
) -> dict[str, Any]:
    part = table.chosen(chosen)
    seen, total_h = np.isfinite(part.enters_s), hours(part, np.ones(len(part), np.bool_))
    is_rate, is_walk = entry.kind in {"pets stay", "thing"}, entry.kind == "walk test"
    figures: dict[str, Any] = {"passages": len(part), "in_view": int(seen.sum())}
    figures |= {"hours": round(total_h, 4)} if is_rate else {}
    for policy in _POLICIES:
        made = verdicts(part, alarms[policy][chosen[table.passage]])
        of: float = len(part)
        if is_rate:
            count, of = int(made.false_alarms.sum()), round(total_h, 4)
        elif is_walk:
            count, of = int((seen & ~made.is_alarm).sum()), int(seen.sum())
        else:
            count = int((made.false_alarms > 0).sum())
        estimate = per_hour(count, total_h) if is_rate else share(count, int(of))
        value, low, high = (float(x) if np.isfinite(x) else None for x in estimate)
        figure = {"count": count, "of": of, "value": value, "low": low, "high": high}
        if is_walk and made.is_alarm.any():
            first_s = np.sort(made.alarm_s[seen])
            # As many as were missed never alarmed: the median is of all in view.
            median_s = first_s[len(first_s) // 2] if len(first_s) else np.inf
            figure["median_s"] = float(median_s) if np.isfinite(median_s) else None
        figures[policy] = figure
    return figures


def lines(made: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield the rows of the table for people: entry, what counts, of how many, both policies."""
    for row in made["entries"]:
        of = f"{row['hours']:.1f} h" if "hours" in row else f"{row['passages']}"
        if row["kind"] == "walk test" and row["in_view"] != row["passages"]:
            of = f"{row['in_view']} of {row['passages']} in view"
        own, window = _cells(row)
        yield row["name"], " ".join(_WORDS[row["kind"]]), of, own, window


def _cells(row: Mapping[str, Any]) -> Iterator[str]:
    """Yield what is said of each policy; only rates have hours."""
    for figure in (row[policy] for policy in _POLICIES):
        if figure["value"] is None:
            yield "-"
        elif "hours" in row:
            yield f"{figure['value']:.2g} ({figure['low']:.2g} to {figure['high']:.2g})"
        else:
            value, low, high = (100 * figure[key] for key in ("value", "low", "high"))
            yield f"{figure['count']}: {value:.1f} % ({low:.1f} to {high:.1f})"


def write_acceptance(
    table: PassageTable,
    out_dir: Path,
    about: Mapping[str, Any],
    entries: Sequence[Entry] = ENTRIES,
) -> dict[str, Any]:
    """Write acceptance.json and .html as `write_files` does; return what is in the JSON."""
    made = document(table, about, entries)
    text = json.dumps(made, indent=1, allow_nan=False) + "\n"
    loader = PackageLoader("x2train.judge", "")
    template = Environment(loader=loader, autoescape=True).get_template("acceptance.html")
    page = template.render(made=made, lines=lines(made), cells=_cells)
    write_files(out_dir, {"acceptance.json": text, "acceptance.html": page})
    return made
