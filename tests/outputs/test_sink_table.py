"""The table of outputs: help, configuration, redaction, reload and docs say what its rows say."""

import importlib
import re
from pathlib import Path

import pytest

from radard.config.credentials import redact
from radard.config.sink_table import SINKS, SinkOptions, find_row

ROOT = Path(__file__).parents[2]
EXAMPLES = {
    "json:FILE": "json:out.jsonl",
    "mqtt://HOST": "mqtt://me:s3cret@broker/hall",
    "mqtts://HOST": "mqtts://me:s3cret@broker",
    "webhook:URL": "webhook:https://me@h.example/hooks/s3cret?token=s3cret",
    "apprise:URL": "apprise:tgram://s3cret:s3cret/s3cret?token=s3cret",
    "exec:COMMAND": "exec:notify --key s3cret",
    "syslog:": "syslog:udp://log.lan:514",
    "lsl:": "lsl:hall",
    "store:FILE": "store:/var/lib/radard/radard.db",
    "http://HOST:PORT": "http://127.0.0.1:8434",
}


def test_the_docs_table_is_the_rows():
    text = (ROOT / "docs" / "reference" / "outputs.md").read_text()
    rows = text.partition("|---|---|---|\n")[2].partition("\n\n")[0].splitlines()
    assert [row.split("`")[1] for row in rows] == [row.form for row in SINKS]


def test_every_section_belongs_to_a_row_and_is_documented():
    sections = set(SinkOptions.model_fields)
    assert {name for row in SINKS for name in row.sections} == sections
    text = (ROOT / "config.yaml").read_text()
    assert {name for name in sections if not re.search(rf"^{name}: ", text, re.MULTILINE)} == set()


@pytest.mark.parametrize("row", SINKS, ids=lambda row: row.form)
def test_a_row_is_found_opened_and_redacted(row):
    example = EXAMPLES.get(row.form, row.form)
    assert find_row(example) is row
    shown = redact(example)
    assert "s3cret" not in shown
    assert ("***" in shown) == ("s3cret" in example)
    module = importlib.import_module(row.module)
    assert callable(module.open_from_url)


@pytest.mark.parametrize(
    "output", ["", "json:", "table:x", "null:", "mqtt:", "exec:", "syslog", "webhook", "odd:x"]
)
def test_incomplete_values_have_no_row(output):
    assert find_row(output) is None
