"""Campaigns say what harm they found, and set the one clock there is; tools/checks runs them."""

import json
import random
import re
from contextlib import ExitStack
from pathlib import Path

import pytest

from campaigns.kept import House
from campaigns.processes import HARM, end_with

ROOT = Path(__file__).parents[2]


@pytest.mark.integration
def test_a_reset_of_a_module_that_a_busy_machine_kept_waiting_is_no_other_decision(tmp_path):
    """Before, what came behind it was held against a run that had no reset."""
    with ExitStack() as stack:
        house = House(tmp_path, random.Random(0), stack)  # noqa: S311 - no secret
    reference = [{"type": "decision", "dropped": 0, "t_s": t_s} for t_s in (2.45, 3.45)]
    late = {"type": "decision", "dropped": 0, "t_s": 5.1}
    fault = {"type": "event", "kind": "fault", "reason": "no frame for 1.5 s"}

    def told(*rows):
        house.out.write_text("".join(json.dumps(row) + "\n" for row in rows))
        return house.look_at_decisions(reference), house.found["decisions_differ"]

    hello = {"type": "hello"}
    assert told(hello, reference[0], fault, late, hello, *reference) == (3, 0)
    assert told(hello, reference[0], late) == (2, 1)


def test_harm_is_said_and_fails_a_campaign(capsys):
    assert [end_with({"runs": 3}), end_with({"lost_events": 1})] == [0, 1]
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert all(set(HARM) <= set(line) for line in lines)


def test_one_module_asks_for_the_clock_on_the_wall():
    """`campaigns/clock.py` sets what that one says."""
    asks = re.compile(r"\btime\.time(_ns)?\b|datetime\.(now|utcnow|today)|\b(local|gm)time\(")
    found = [
        path.relative_to(ROOT).as_posix()
        for folder in ("x2radar", "daemon")
        for path in sorted((ROOT / folder).rglob("*.py"))
        if asks.search(path.read_text())
    ]
    assert found == ["x2radar/wall_clock.py"]
