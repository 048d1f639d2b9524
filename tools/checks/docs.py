"""What the documentation says of the program holds: `python tools/checks/docs.py`.

Each check yields one line for what does not hold. Links and anchors of the site are checked by
`mkdocs build --strict`, blocks of code by blocks.py, and run by tests/house/test_docs_blocks.py.
"""

import argparse
import ast
import contextlib
import importlib
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "daemon"), str(ROOT / "training")]

import yaml  # noqa: E402 - the path comes first

from tools.site.sentences import too_long  # noqa: E402
from x2radar import manual  # noqa: E402

PAGES = sorted(
    page
    for pattern in ("*.md", "docs/**/*.md", "deploy/*.md", "models/*.md")
    for page in ROOT.glob(pattern)
    if page.name != "CHANGELOG.md"
)
PACKAGES = {"x2radar": "x2radar", "radard": "daemon/radard", "x2train": "training/x2train"}
FOLDERS = (*PACKAGES.values(), "tests", "benchmarks", "campaigns", "tools", "research")
MADE = {"models/tiny.onnx", "models/mine.onnx", "models/tinier.onnx"}
"""Files that the examples of a page make."""
GROUPS = {"radard.sources", "radard.sinks", "radard.features", "x2radar.bodies"}
"""Entry point groups, which look like modules."""
RULE_PAGES = ("README.md", "config.yaml", "docs/what-stops-an-alarm.md", "docs/how-it-decides.md")


def read(name: str) -> str:
    """Return a file of the project."""
    return (ROOT / name).read_text("utf-8")


@cache
def prose(page: Path) -> str:
    """Return a page without its code blocks."""
    return re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)


@cache
def anchors(page: Path) -> set[str]:
    """Return what a repository's viewer makes of a page's headings."""
    heads = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@cache
def resolves(name: str) -> bool:
    """Return whether a dotted name is a module, or an attribute of one."""
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


def links() -> Iterator[str]:
    """Links lead to files and headings that are there."""
    for page in PAGES:
        for link in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
            path, _, anchor = link.partition("#")
            if re.match(r"[a-z]+:", link):
                continue
            target = page.parent / path if path else page
            if not target.exists() or (anchor and anchor not in anchors(target)):
                yield f"{page.relative_to(ROOT)}: no {link}"


def names() -> Iterator[str]:
    """Paths and modules in backquotes are there."""
    tops = {path.name for path in ROOT.iterdir()} | set(PACKAGES)
    files = [
        f"/{p.relative_to(ROOT)}" for folder in FOLDERS for p in (ROOT / folder).rglob("*.py")
    ]
    roots = (ROOT, ROOT / "daemon", ROOT / "training")
    module = re.compile(rf"(?:{'|'.join(PACKAGES)})(?:\.\w+)+")
    for page in PAGES:
        for word in (w for q in re.findall(r"`([^`\n]+)`", prose(page)) for w in q.split()):
            is_path = "/" in word and word.partition("/")[0] in tops and word not in MADE
            is_topic = re.search(r"/[A-Z]+(/|$)", word)
            is_unit = word.rpartition(".")[2] in {"service", "db", "yaml"}
            if is_path and not is_topic and re.fullmatch(r"[\w./*-]+", word):
                if not any(list(root.glob(word.rstrip("/"))) for root in roots):
                    yield f"{page.relative_to(ROOT)}: no path {word}"
            elif re.fullmatch(r"(?:\w+/)*\w+\.py", word):
                if not any(file.endswith(f"/{word}") for file in files):
                    yield f"{page.relative_to(ROOT)}: no file {word}"
            elif module.fullmatch(word) and not is_unit and word not in GROUPS:
                if not resolves(word):
                    yield f"{page.relative_to(ROOT)}: no module {word}"


def settings() -> Iterator[str]:
    """Settings that pages name are there, with the defaults that what-stops-an-alarm gives."""
    from radard.config.config import Config  # noqa: PLC0415

    built_in = Config().model_dump(mode="json")
    sections = "|".join(built_in)
    page = read("docs/what-stops-an-alarm.md")
    given = dict(re.findall(r"`([a-z]+\.[a-z_]+): ([^`]+)`", page))
    for name, text in given.items():
        section, key = name.split(".")
        if built_in.get(section, {}).get(key) != yaml.safe_load(text):
            yield f"what-stops-an-alarm.md: {name} is not {text}"
    for section in ("decision", "alarm", "zones"):
        for key in built_in[section]:
            if f"{section}.{key}" not in given:
                yield f"what-stops-an-alarm.md: {section}.{key} is left out"
    for name in ("docs/what-stops-an-alarm.md", "docs/threat-model.md"):
        for section, key in re.findall(rf"`({sections})\.([a-z_]+)`", read(name)):
            if not isinstance(built_in[section], dict) or key not in built_in[section]:
                yield f"{name}: no setting {section}.{key}"


def rule() -> Iterator[str]:
    """The rule is told alike everywhere."""
    for name in RULE_PAGES:
        text = " ".join(read(name).replace("#", " ").split())
        if "p(pet) + p(other)" not in text or "at least 0.5" not in text:
            yield f"{name}: does not tell the rule"


def messages() -> Iterator[str]:
    """What troubleshooting.md and what-stops-an-alarm.md quote is what the programs say."""
    source = "\n".join(
        path.read_text("utf-8")
        for top in ("daemon", "x2radar")
        for path in (ROOT / top).rglob("*.py")
    )
    flat = re.sub(r'"\s*\n\s*f?"', "", source)
    page = read("docs/troubleshooting.md")
    parts = re.split(r"^## (.*)$", page, flags=re.MULTILINE)
    told = dict(zip(parts[1::2], parts[2::2], strict=True))
    for heading in (
        "The radar does not answer",
        "radard does not start",
        "The state is not online",
    ):
        for cell in re.findall(r"^\| ([^|]+) \|", told[heading], re.MULTILINE)[1:]:
            for text in re.findall(r"`([^`]+)`", cell):
                # A number is what the program fills in.
                pattern = re.sub(
                    r"\\? (\d+(?:\\\.\d+)?) ", r" .+ ", re.escape(text).replace(r"\ ", " ")
                )
                if not re.search(pattern, flat) and not all(p in flat for p in text.split(": ")):
                    yield f"troubleshooting.md: nothing says '{text}'"
    why = read("docs/what-stops-an-alarm.md").replace("\n", " ")
    for text in re.findall(r'\*Why\*[^|]*?"([^"]+)"', why):
        if text not in flat:
            yield f"what-stops-an-alarm.md: nothing says '{text}'"


def exit_codes() -> Iterator[str]:
    """The table of exit codes has those of the errors, and no others."""
    raised = {
        each.exit_code
        for module in ("radard.errors", "x2radar.errors")
        for each in vars(importlib.import_module(module)).values()
        if isinstance(each, type) and hasattr(each, "exit_code")
    }
    table = read("docs/troubleshooting.md").split("## Exit codes")[1].split("\n## ")[0]
    listed = {int(code) for code in re.findall(r"^\| (\d+) \|", table, re.MULTILINE)}
    if listed != {0, *raised}:
        yield f"troubleshooting.md: exit codes {sorted(listed)}, raised are {sorted(raised)}"


def claims() -> Iterator[str]:
    """Every claim of the threat model, in tests/claims.yaml, has tests or checks."""
    known = {
        name
        for path in (*(ROOT / "tests").rglob("test_*.py"), *(ROOT / "tools/checks").glob("*.py"))
        for name in re.findall(r"^ *(?:async )?def (\w+)", path.read_text(), re.MULTILINE)
    }
    for claim, names in yaml.safe_load(read("tests/claims.yaml")).items():
        for name in names or ["any"]:
            if name not in known:
                yield f"tests/claims.yaml: no test {name} of '{claim}'"


def accuracy() -> Iterator[str]:
    """docs/accuracy.md gives the rates of the default bundle's card."""
    made = subprocess.run(
        [sys.executable, "tools/home_rows.py"],
        cwd=ROOT,
        env={"PYTHONPATH": f"{ROOT}:{ROOT / 'daemon'}", "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    if made not in read("docs/accuracy.md"):
        yield f"accuracy.md: has not the rows of tools/home_rows.py:\n{made}"


def frame() -> Iterator[str]:
    """follow-a-frame.md names files and functions that are there."""
    page = read("docs/research/follow-a-frame.md")
    rows = re.findall(r"^\| \w \|.*\| `([\w/.]+)` \| (.*) \|$", page, re.MULTILINE)
    if len(rows) < 8:
        yield "follow-a-frame.md: fewer than eight files"
    for path, functions in rows:
        tree = ast.parse(read(path)) if (ROOT / path).is_file() else ast.parse("")
        defined = {n.name for n in ast.walk(tree) if isinstance(n, ast.ClassDef | ast.FunctionDef)}
        for name in re.findall(r"`([\w.]+)`", functions):
            if name.rpartition(".")[2] not in defined:
                yield f"follow-a-frame.md: no {name} in {path}"


def rooms() -> Iterator[str]:
    """CONTRIBUTING.md lists every folder of the three packages, and none that is gone."""
    text = read("CONTRIBUTING.md")
    roots = [ROOT, *(ROOT / package for package in PACKAGES.values())]
    for name in re.findall(r"^\* `(\w+)/`", text, re.MULTILINE):
        if not any((root / name).is_dir() for root in roots):
            yield f"CONTRIBUTING.md: no folder {name}/"
    for package in PACKAGES.values():
        for init in (ROOT / package).glob("*/__init__.py"):
            if f"`{init.parent.name}/`" not in text:
                yield f"CONTRIBUTING.md: no line for {package}/{init.parent.name}/"


def notebooks() -> Iterator[str]:
    """Notebooks begin with a heading, and are kept with what they show."""
    for path in (ROOT / "docs/notebooks").glob("*.ipynb"):
        first, *_ = cells = json.loads(path.read_text("utf-8"))["cells"]
        if not "".join(first["source"]).startswith("# "):
            yield f"{path.name}: no heading"
        outputs = [output for cell in cells for output in cell.get("outputs", ())]
        if not outputs or any(each["output_type"] == "error" for each in outputs):
            yield f"{path.name}: run tools/notebooks.py {path.stem}"


def _commands(whole: argparse.ArgumentParser) -> Iterator[str]:
    """Yield what a command's help lacks, and what completion does not name."""
    scripts = [manual.completion(whole, shell) for shell in manual.SHELLS]
    todo = [whole]
    while todo:
        parser = todo.pop()
        todo += manual.subparsers(parser).values()
        if not (parser.description or "")[:1].isupper():
            yield f"{parser.prog}: no description"
        examples = (parser.epilog or "").partition("example")[2]
        if parser.prog not in examples:
            yield f"{parser.prog}: no example"
        if parser.prog.startswith("radard") and max(map(len, examples.splitlines())) > 85:
            yield f"{parser.prog}: an example is too long"
        for action in parser._actions:
            if not action.help and action.nargs != argparse.PARSER:
                yield f"{parser.prog} {action.dest}: no help"
            is_shown = action.help != argparse.SUPPRESS
            for option in () if parser is whole else action.option_strings:
                if any((option in each) is not is_shown for each in scripts):
                    yield f"{parser.prog} {option}: completion is wrong of it"


def commands() -> Iterator[str]:
    """Every command says what it does, with an example and help for all; so do the man pages."""
    wholes: list[argparse.ArgumentParser] = []
    manual.man_page, made = lambda parser: wholes.append(parser) or "", manual.man_page
    for package in PACKAGES:
        with contextlib.suppress(SystemExit), contextlib.redirect_stdout(None):
            importlib.import_module(f"{package}.cli").main(["--print-man"])
    manual.man_page = made
    if len(wholes) < len(PACKAGES):
        yield "a command prints no man page"
    for whole in wholes:
        yield from _commands(whole)
    if groff := shutil.which("groff"):
        for whole in wholes:
            argv, page = [groff, "-man", "-Tutf8", "-ww", "-z"], made(whole)
            done = subprocess.run(argv, input=page, capture_output=True, text=True, check=True)
            # A long word in a narrow place: adjusting is no fault of ours.
            odd = re.compile("cannot adjust|can't break")
            faults = [line for line in done.stderr.splitlines() if not odd.search(line)]
            yield from (f"man page of {whole.prog}: {fault}" for fault in faults)


CHECKS = (
    *(links, names, settings, rule, messages, exit_codes, claims, accuracy, frame, rooms),
    *(notebooks, commands, too_long),
)


def main() -> int:
    """Print what does not hold; return 1 if there is anything."""
    found = [line for check in CHECKS for line in check()]
    for line in found:
        print(line)
    print(f"docs: {len(CHECKS)} checks of {len(PAGES)} pages, {len(found)} complaints")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
