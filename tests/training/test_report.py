"""The report: JSON by its schema, a page that needs nothing beside it, tables made of both."""

import json
import re
from html.parser import HTMLParser
from importlib import resources

import jsonschema
import numpy as np
import pytest

from radard.errors import UsageError
from tests.processes import ROOT, ran
from tests.report_helpers import drawn, passage, table_of
from x2train.judge.figures import figures
from x2train.judge.page import rate_text, share_text
from x2train.judge.report import pairings, write

pytestmark = pytest.mark.integration

PNG = b"\x89PNG\r\n\x1a\n"


def check_schema(made):
    text = resources.files("x2train.judge").joinpath("report.schema.json").read_text()
    jsonschema.Draft202012Validator(json.loads(text)).validate(made)


class Page(HTMLParser):
    """Checks that tags close in order, and collects what a page loads."""

    def __init__(self, text):
        super().__init__()
        self.open, self.loads, self.words = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.loads += [value for name, value in attrs if name in ("src", "href", "xlink:href")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_startendtag(self, _tag, attrs):
        self.handle_starttag("img", attrs)  # nothing to close

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data.strip())


TABLES = {
    "empty": table_of,
    "people only": lambda: table_of(*(passage([0.1, 0.2]) for _ in range(3)), passage([0.9])),
    "pets only": lambda: table_of(*(passage([0.9, 0.2], "pet") for _ in range(3))),
    "nothing known": lambda: table_of(
        passage([np.nan] * 4),
        passage([np.nan] * 4, "pet"),
        passage([], duration_s=1.0),
        passage([0.5] * 3, "empty", is_open=False, enters_s=np.nan),
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_any_table_makes_a_report(tmp_path, name):
    made = write(TABLES[name](), tmp_path / "new" / "folder", title=name)
    check_schema(made)
    assert json.loads((tmp_path / "new" / "folder" / "report.json").read_text()) == made
    page = Page((tmp_path / "new" / "folder" / "report.html").read_text(encoding="utf-8"))
    assert name in page.words
    assert not {"nan", "inf", "None"} & set(page.words)
    assert "other" not in made or made["other"] is None


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    other, title = drawn(200, skill=1.0), "a < b & c"
    made = write(drawn(200), folder, title=title, other=other, render=lambda _: PNG)
    return made, (folder / "report.html").read_text(encoding="utf-8")


def test_figures_are_those_of_the_table(compared):
    made, _ = compared
    check_schema(made)
    table = drawn(200)
    shipped = made["operating_points"][0]["outcome"]
    assert shipped["n_intrusions"] == (table.label == "human").sum()
    assert made["passages"]["pet"] == (table.label == "pet").sum()
    for key in ("split", "family", "speed_mps", "range_m", "aspect_deg", "snr_db"):
        rows = made["groups"][key]
        assert sum(g["shipped"]["n_intrusions"] for g in rows) == shipped["n_intrusions"]
        assert sum(g["shipped"]["n_false_alarms"] for g in rows) == shipped["n_false_alarms"]
    assert {g["name"] for g in made["groups"]["suite"]} == set(table.suite) - {""}
    assert "build" not in made["groups"]  # too many to read
    points = {p["name"]: p for p in made["operating_points"]}
    assert not points["fused evidence, one false alarm in 60 pet-hours"]["is_resolved"]
    assert not any("180" in name for name in points)


def test_page_needs_nothing_beside_it(compared):
    _, text = compared
    assert all(load.startswith(("#", "data:image/png;base64,")) for load in Page(text).loads)
    assert "url(http" not in text
    names = {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert set(re.findall(r"https?://[^\"' ]+", text)) <= names
    assert "a &lt; b &amp; c" in text
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'(?:url\(|href=")#([^")]+)', text)) <= set(ids)
    # Its colours are the page's own.
    assert "#0102" not in text
    assert "currentColor" in text


def test_same_table_same_bytes(tmp_path):
    for name in ("first", "second"):
        write(drawn(60), tmp_path / name, title="t")
    for name in ("report.json", "report.html"):
        first, second = ((tmp_path / k / name).read_bytes() for k in ("first", "second"))
        assert first == second


def test_other_model_is_compared_passage_by_passage():
    people = ([0.1], [0.1], [0.9], [0.9], [0.9])
    others = ([0.1], [0.9], [0.1], [0.1], [0.9])
    here = table_of(*map(passage, people), *(passage(q, "pet") for q in ([0.9], [0.1])))
    there = table_of(*map(passage, others), *(passage(q, "pet") for q in ([0.1], [0.9])))
    pair, _ = pairings(here, figures(here), figures(there))
    assert pair["missed"] == {"both": 1, "here": 2, "there": 1}
    assert pair["alarmed"] == {"both": 0, "here": 1, "there": 1}
    less = pair["miss_rate_less_other"]
    assert less.value == pytest.approx(0.2)
    assert less.low < 0.2 < less.high


def test_other_passages_are_refused(tmp_path):
    table = table_of(passage([0.1]), passage([0.1], enters_s=np.nan))
    with pytest.raises(UsageError, match="saw other passages"):
        write(table, tmp_path, title="", other=table_of(passage([0.1])))
    other = table_of(passage([0.1]), passage([0.1], family="dog", enters_s=np.nan))
    with pytest.raises(UsageError, match="their family is not the same"):
        write(table, tmp_path, title="", other=other)
    assert not (tmp_path / "report.json").exists()


DASH = "\N{EN DASH}"
WORDS = [
    (share_text, (None, 0.0, 1.0), DASH),
    (share_text, (0.0, 0.0, 0.0034), "0 % (0 to 0.34)"),
    (share_text, (0.123, 0.1, 0.15), "12.3 % (10 to 15)"),
    (share_text, (0.9995, 0.998, 1.0), "99.95 % (99.8 to 100)"),
    (rate_text, (None, 0.0, None), DASH),
    (rate_text, (0.0, 0.0, 0.0166), "< 0.017"),
    (rate_text, (0.0133, 0.0021, 0.051), "0.013 (0.0021 to 0.051)"),
    (rate_text, (123.0, 99.0, 140.0), "123 (99 to 140)"),
]


@pytest.mark.parametrize(("say", "estimate", "text"), WORDS)
def test_estimates_in_words(say, estimate, text):
    assert say(dict(zip(("value", "low", "high"), estimate, strict=True))) == text


@pytest.mark.parametrize("tool", ["report_rows.py", "suite_rows.py"])
def test_tables_of_two_reports(tool, tmp_path):
    table = drawn(300)
    for name in ("mine", "theirs"):
        write(table, tmp_path / name, title=f"Bundle {name}, policy fused")
        about = {"seed": 51, "radar": "suites", "n_passages": 300}
        table.save(tmp_path / name / "passages", about)
    done = ran(ROOT / "tools" / tool, tmp_path / "mine", tmp_path / "theirs")
    assert done.returncode == 0, done.stderr
    assert "mine" in done.stdout
    assert "theirs" in done.stdout
    done = ran(ROOT / "tools" / tool, tmp_path)
    assert (done.returncode, "Traceback" in done.stderr) == (2, False)
    assert "holds no report.json" in done.stderr
