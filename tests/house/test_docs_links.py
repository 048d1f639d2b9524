"""What the documentation points at is there: links, repository paths, module names."""

import importlib
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    page
    for pattern in ("*.md", "docs/**/*.md", "deploy/*.md", "models/*.md")
    for page in ROOT.glob(pattern)
    if page.name != "CHANGELOG.md"
)
TOPS = {path.name for path in ROOT.iterdir()}
PACKAGES = {"x2radar": "x2radar", "radard": "daemon/radard", "x2train": "training/x2train"}
MADE = {"models/tiny.onnx", "models/mine.onnx", "models/tinier.onnx"}
"""Files that the examples of a page make."""
GROUPS = {"radard.sources", "radard.sinks", "radard.features", "x2radar.bodies"}
"""Entry point groups, which look like modules."""


def text_of(page: Path) -> str:
    """A page without its code blocks."""
    return re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)


@cache
def anchors(page: Path) -> set[str]:
    """What GitHub makes of a page's headings."""
    heads = re.findall(r"^#+ (.*)$", text_of(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def there(path: str) -> bool:
    """Whether a path exists, from the root or from one of the packages' folders."""
    roots = (ROOT, ROOT / "daemon", ROOT / "training")
    return any(list(root.glob(path)) for root in roots)


def resolves(name: str) -> bool:
    """Whether a dotted name is a module, or an attribute of one."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:n]))
        except ModuleNotFoundError:
            continue
        for part in parts[n:]:
            if not hasattr(found, part) and part not in getattr(found, "__annotations__", {}):
                return False
            found = getattr(found, part, None)
        return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^)\s]+)\)", text_of(page))
    links += re.findall(r'<img src="([^"]+)"', text_of(page))
    for link in links:
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target), link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_paths_are_there(page):
    for quoted in re.findall(r"`([^`\n]+)`", text_of(page)):
        for word in quoted.split():
            top = word.partition("/")[0]
            is_path = "/" in word and (top in TOPS or top in PACKAGES)
            is_topic = re.search(r"/[A-Z]+(/|$)", word)
            if is_path and not is_topic and word not in MADE and re.fullmatch(r"[\w./*-]+", word):
                assert there(word.rstrip("/")), word


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_names_of_modules_are_right(page):
    packages = "|".join(PACKAGES)
    for name in re.findall(rf"`((?:{packages})(?:\.\w+)+)`", text_of(page)):
        is_file = name.rpartition(".")[2] in {"service", "db", "yaml"}
        assert is_file or name in GROUPS or resolves(name), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_named_by_their_end_are_there(page):
    known = [
        f"/{path.relative_to(ROOT)}"
        for folder in (*PACKAGES.values(), "tests", "benchmarks", "campaigns", "tools")
        for path in (ROOT / folder).rglob("*.py")
    ]
    for name in re.findall(r"`((?:\w+/)*\w+\.py)`", text_of(page)):
        assert any(path.endswith(f"/{name}") for path in known), name


def test_readme_is_short_and_begins_with_a_picture():
    lines = (ROOT / "README.md").read_text("utf-8").splitlines()
    assert len(lines) <= 80
    assert any(line.startswith("![") for line in lines[:5])
    assert [line.split()[0] for line in lines if line.startswith("    ")] == ["./run", "./test"]


def test_contributing_lists_every_room():
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    for package in PACKAGES.values():
        rooms = {init.parent.name for init in (ROOT / package).glob("*/__init__.py")}
        assert rooms
        for room in rooms:
            assert f"`{room}/`" in text, f"{package}/{room}"
