"""The site of the documentation: it builds strictly, stands alone, and leads a stranger there."""

import os
import re
import shutil
import subprocess
import sys
from collections import Counter, deque
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
import yaml

from tests.waiting import wait_for
from x2radar.wire.layouts import COMMAND_VARIANTS, COMMANDS, RESPONSE_VARIANTS, RESPONSES

pytest.importorskip("mkdocs", reason="no mkdocs: pip install '.[docs]'")
ROOT = Path(__file__).parents[2]
CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium")
VOID = {
    "area",
    "base",
    "br",
    "col",
    "embed",
    "hr",
    "img",
    "input",
    "link",
    "meta",
    "source",
    "wbr",
}
TOP = [
    "Start",
    "Install",
    "Mount and commission",
    "Home Assistant",
    "Troubleshooting",
    "How it decides",
    "What stops an alarm",
    "Accuracy",
    "For researchers",
    "Reference",
    "Glossary",
    "Privacy",
    "Contribute",
]
QUESTIONS = {
    "how to install": ("install.html", "pip install"),
    "where to mount": ("mounting.html", "in a corner that looks at the door"),
    "why an alarm came": ("how-it-decides.html", "Does it count as a person?"),
    "why none came": ("what-stops-an-alarm.html", "The verdict is no alarm"),
    "how accurate it is in a home": ("accuracy.html", "with an alarm"),
    "how to add a sink": ("research/extending.html#a-sink", "DirectSink"),
    "how to train on one's own pet": ("training.html#your-own-pet", "train-export finetune"),
}
"""What a stranger asks: the page that answers, and words of the answer."""


class Parsed(HTMLParser):
    """What of a page matters here: ids, links of the article, what the browser loads."""

    def __init__(self, path):
        super().__init__()
        self.ids, self.links, self.article_links, self.loads = set(), [], [], []
        self._within = []
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag not in VOID:
            self._within.append(tag)
        self.ids |= {values[key] for key in ("id", "name") if values.get(key)}
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
            if "article" in self._within:
                self.article_links.append(values["href"])
        is_loaded = tag == "link" and values.get("rel") not in {"canonical", "next", "prev"}
        if is_loaded and values.get("href"):
            self.loads.append(values["href"])
        if tag in {"script", "img", "iframe", "source", "video"} and values.get("src"):
            self.loads.append(values["src"])

    def handle_endtag(self, tag):
        if tag in self._within:
            while self._within.pop() != tag:
                pass


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site: every page by its path, parsed."""
    folder = tmp_path_factory.mktemp("site")
    roots = [str(ROOT / name) for name in (".", "daemon", "training")]
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(roots), "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site):
    return {
        str(path.relative_to(site)): Parsed(path)
        for path in site.rglob("*.html")
        if path.name != "404.html"
    }


def target(page, link):
    """Page and anchor of a link of a page; None where it leaves the site."""
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return None
    path = os.path.normpath(Path(page).parent / unquote(parts.path)) if parts.path else page
    return path, unquote(parts.fragment)


def test_the_pages_are_those_promised():
    nav = yaml.load(
        re.sub(r"!!python\S*", "", (ROOT / "mkdocs.yml").read_text("utf-8")), yaml.SafeLoader
    )["nav"]
    assert [name for entry in nav for name in entry] == TOP


def test_every_link_and_anchor_leads_somewhere(site, pages):
    for name, page in pages.items():
        for link in page.links:
            found = target(name, link)
            if found is None:
                continue
            path, anchor = found
            if path in pages:
                assert not anchor or anchor in pages[path].ids, (name, link)
            else:
                assert (site / path).exists(), (name, link)


def test_nothing_is_loaded_from_elsewhere(site, pages):
    for name, page in pages.items():
        for link in page.loads:
            found = target(name, link)
            assert found is not None, (name, link)
            assert (site / found[0]).is_file(), (name, link)
    for path in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import)\s*[\"']?(https?:)?//", path.read_text("utf-8")), (
            path
        )


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_stranger_finds_the_answer_in_three_clicks(question, site, pages):
    """By links of the text alone, without the menu and the search."""
    wanted, words = QUESTIONS[question]
    path, _, anchor = wanted.partition("#")
    clicks, waiting = {"index.html": 0}, deque(["index.html"])
    while waiting:
        page = waiting.popleft()
        for link in pages[page].article_links:
            found = target(page, link)
            if found is None or found[0] not in pages:
                continue
            here = f"{found[0]}#{found[1]}"
            for each in (found[0], here):
                if each not in clicks:
                    clicks[each] = clicks[page] + 1
                    if each in pages:
                        waiting.append(each)
    assert clicks[wanted] <= 3
    assert words in re.sub(r"<[^>]+>", "", (site / path).read_text("utf-8"))
    assert not anchor or anchor in pages[path].ids


def test_parts_made_from_the_program_are_in_place(site):
    for page, words in {
        "reference/cli.html": ("radard walktest", "x2radar decode", "train-export leave-one-out"),
        "reference/config.html": ("refractory_s", "keep_days", "pet_limit"),
        "reference/http-api.html": ("/api/v1/decisions/{seq}", "the newest so many"),
        "reference/outputs.html": ("fused_p_human", "start_t_s"),
        "reference/python.html": ("open_reconnecting", "RecordingWriter", "PortNotFound"),
        "research/simulated-module.html": ("safe_mode", "up to 3 samples lie far above"),
        "researchers.html": ("balanced accuracy",),
        "contribute.html": ("Wire code owns no port",),
        "notebooks/1-simulate-and-look.html": ("import x2radar",),
    }.items():
        text = re.sub(r"<[^>]+>", "", (site / page).read_text("utf-8"))
        for each in words:
            assert each in text, (page, each)


def test_every_message_is_in_the_reference(site):
    page = (site / "reference" / "protocol.html").read_text("utf-8")
    cells = re.findall(r"<td><code>(\w+)</code></td>\s*<td><code>([0-9a-f ]+)</code></td>", page)
    rows = COMMANDS + COMMAND_VARIANTS + RESPONSES + RESPONSE_VARIANTS
    assert Counter(cells) == Counter((row.cls.__name__, row.prefix.hex(" ")) for row in rows)
    for part in ("f32 i[n], f32 q[n]", "u32 n1, u32 n2", "u32 code, anything", "i32 value"):
        assert part in page


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")
@pytest.mark.parametrize("width", [390, 1280])
def test_it_reads_and_searches_from_a_folder(site, width):
    """Opened as files, without a server: no request leaves, nothing is wider than the screen."""
    api = pytest.importorskip("playwright.sync_api", reason="no playwright: '.[browser]'")
    with api.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": 844})
        page.set_default_timeout(60_000)
        asked, complaints = [], []
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        for path in ("index.html", "what-stops-an-alarm.html", "reference/config.html"):
            page.goto(f"file://{site}/{path}")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.goto(f"file://{site}/index.html")
        if width < 1000:
            page.click("label[for=__search].md-header__button")
        page.click("input[name=query]")
        page.keyboard.type("calibration")
        found = ".md-search-result__item a"
        wait_for(lambda: page.locator(found).count() > 2)
        assert not complaints
        assert {urlsplit(url).scheme for url in asked} <= {"file", "data", "blob"}
        browser.close()
