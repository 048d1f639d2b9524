"""docs/threat-model.md: every claim names tests, and the tests, settings and files are there."""

import re
from pathlib import Path

from radard.config.config import Config

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/threat-model.md").read_text()


def claims():
    """Rows of the table of claims: claim and names of tests."""
    table = PAGE.split("## Claims and their tests")[1].split("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| ")]
    return [(claim, tests.split(", ")) for claim, tests in rows if claim != "claim"]


def test_every_claim_has_tests_that_there_are():
    known = set()
    for path in (ROOT / "tests").glob("test_*.py"):
        known |= set(re.findall(r"^(?:async )?def (test_\w+)", path.read_text(), re.MULTILINE))
    assert len(claims()) > 20
    for claim, tests in claims():
        assert tests
        assert set(tests) <= known, claim


def test_every_setting_of_the_page_is_one():
    sections = "|".join(Config.model_fields)
    named = set(re.findall(rf"`({sections})\.(\w+)\b", PAGE))
    assert len(named) > 5
    for section, key in named:
        assert key in Config.model_fields[section].annotation.model_fields, f"{section}.{key}"


def test_every_output_is_on_the_page():
    text = PAGE.lower()
    for word in ("http", "mqtt", "webhook", "exec", "syslog", "state directory", "serial port"):
        assert word in text
