"""Print docs/accuracy.md's table of a night with a pet, as Markdown, from a bundle's card.

python tools/home_rows.py [MODEL]
"""

import sys

from radard.judge.bundle import Passing, read_card

VISITS = 10  # in a night; chosen, as the page says


def rows(model: str) -> list[str]:
    """Return the table's lines; raises KeyError if the card lacks a sensitivity."""
    found = read_card(model).sensitivities
    of = [found[name] for name in ("low", "normal", "high")]

    def row(name: str, cells: list[str]) -> str:
        return f"| {name} | {' | '.join(cells)} |"

    return [
        "| sensitivity | `low` | `normal` | `high` |",
        "|---|---|---|---|",
        row(
            "of 100 people who come in, without an alarm", [f"{100 * p.missed[0]:.2g}" for p in of]
        ),
        row("time to the alarm, for half of the people", [_seconds(p) for p in of]),
        row(
            "of 100 visits of a pet, with an alarm",
            [f"{100 * p.visits_with_alarm[0]:.2g}" for p in of],
        ),
        row(
            "ten visits in a night: false alarms",
            [f"{VISITS * p.visits_with_alarm[0]:.1f}" for p in of],
        ),
        row(
            "ten visits in a night: nights with at least one",
            [f"{100 * (1 - (1 - p.visits_with_alarm[0]) ** VISITS):.0f} %" for p in of],
        ),
    ]


def _seconds(passing: Passing) -> str:
    seconds = passing.half_alarmed_after_s[0]
    return "never" if seconds is None else f"{seconds:.1f} s"


if __name__ == "__main__":
    sys.stdout.write("\n".join(rows(sys.argv[1] if len(sys.argv) > 1 else "accurate")) + "\n")
