"""What pages show and nothing runs is sound all the same: `python tools/checks/blocks.py`.

Blocks with a reason not to be run, commands within sentences and blocks of data go through the
parsers of the programs themselves, and the start page shows what its commands print. The rest is
run by tests/house/test_docs_blocks.py.
"""

import argparse
import contextlib
import io
import json
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "daemon"), str(ROOT / "training")]

from radard.cli import main as radard  # noqa: E402 - the path comes first
from radard.config.config import Config  # noqa: E402
from tools.pages import PAGES, PROGRAMS, Block, blocks_of, inline_commands  # noqa: E402
from x2radar.cli import main as x2radar  # noqa: E402
from x2radar.command import Parser  # noqa: E402
from x2radar.sim.scene.scene import parse_scene  # noqa: E402
from x2train.cli import main as train_export  # noqa: E402

MAINS: dict[str, Callable[[Sequence[str]], int]] = {
    "radard": radard,
    "x2radar": x2radar,
    "train-export": train_export,
}
ALL = [block for path in PAGES for block in blocks_of(path)]
_PARSE = argparse.ArgumentParser.parse_args
_IS_PART = re.compile("arguments are required|expected ")


class Parsed(BaseException):
    """A command's arguments were taken; no Exception, which the commands turn into a line."""


def complaint(words: Sequence[str], *, is_whole: bool = True) -> str:
    """Return what a program says of its arguments: nothing, if it takes them."""

    def parse_only(self: Any, args: Any = None, namespace: Any = None) -> None:
        _PARSE(self, args, namespace)
        raise Parsed

    def error(_self: Any, message: str) -> None:
        raise Parsed(message)

    argparse.ArgumentParser.parse_args = parse_only  # type: ignore[assignment, method-assign]
    Parser.error = error  # type: ignore[assignment, method-assign]
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            # As --help does.
            return f"ends with {code}" if (code := MAINS[words[0]](words[1:])) else ""
    except Parsed as taken:
        said = str(taken)
        return "" if not is_whole and _IS_PART.search(said) else said
    except SystemExit as end:
        return f"ends with {end.code}" if end.code else ""
    finally:
        argparse.ArgumentParser.parse_args = _PARSE  # type: ignore[method-assign]


def not_run() -> Iterator[str]:
    """Yield what of the blocks that are not run is no command, no Python, or has no short form."""
    for block in (each for each in ALL if each.reason):
        if block.kind == "python":
            compile(block.text, block.name, "exec")
        if block.kind == "sh":
            yield from unsound(block)
        # Nothing is passed over for its length alone.
        if re.search(r"minute|hour|a while", block.reason) and not any(block.tried()):
            yield f"{block.name}: says not how it is tried"


def unsound(block: Block) -> Iterator[str]:
    """Yield what of a block of commands no shell or none of our programs would take."""
    asked = subprocess.run(["bash", "-n"], input=block.text.encode(), check=False)  # noqa: S607
    if asked.returncode:
        yield f"{block.name}: no shell takes it"
    for command in block.commands():
        for each in re.split(r" (?:&&|\|\|?) ", command):
            words = shlex.split(each)
            if words[0] == "./run":
                words[0] = "radard"
            if words[0] == "sudo":
                words = words[words.index("radard") :] if "radard" in words else words[1:]
            if words[0] in PROGRAMS and (said := complaint(words)):
                yield f"{block.name}: {each}: {said}"


def within_sentences() -> Iterator[str]:
    """Yield commands within sentences that do not parse; arguments may be left out there."""
    for path in PAGES:
        for words in inline_commands(path):
            plain = [re.sub(r"^(S|K|N|NAME)$", "1", word) for word in words]
            if said := complaint(plain, is_whole=False):
                yield f"{path.name}: {shlex.join(words)}: {said}"


def data() -> Iterator[str]:
    """Yield blocks of data that are not what the program takes."""
    for block in (each for each in ALL if each.kind in {"yaml", "json", "toml"}):
        try:
            taken(block)
        except Exception as err:  # noqa: BLE001 - said, whatever it is
            yield f"{block.name}: {err}"


def taken(block: Block) -> None:
    """Read a block of data as whoever takes it does."""
    if block.kind == "toml":
        tomllib.loads(block.text)
    elif block.kind == "json":
        for line in block.text.splitlines() if block.text.count("\n{") else [block.text]:
            json.loads(line)
    else:
        tree = yaml.safe_load(block.text)
        if set(tree) <= set(Config.model_fields):
            Config.model_validate(tree)
        elif "steps" in tree and not block.page.endswith("extending.md"):
            parse_scene(block.text, block.name, block.name)


def start_page() -> Iterator[str]:
    """Yield where the start page shows anything but what its commands print."""
    page = ROOT / "docs/index.md"
    (shown,) = (block.text for block in blocks_of(page) if block.kind == "text")
    (seed,) = re.findall(r"`seed=(\d+)` is one that does", page.read_text("utf-8"))
    now, alarmed = printed("1"), printed(seed)
    if "ALARM" in now or "ALARM new" not in alarmed:
        yield f"index.md: seed 1 makes an alarm, or seed {seed} none"
    rows = {words[0]: words for words in map(str.split, now.splitlines()) if len(words) == 8}
    for wanted in map(str.split, shown.splitlines()[1:]):
        told = rows.get(wanted[0], [""] * 8)
        is_same = (told[1], told[-1]) == (wanted[1], wanted[-1])
        # Processors round differently.
        is_near = wanted[5] == "-" or abs(float(told[5]) - float(wanted[5])) <= 0.02
        if not (is_same and is_near):
            yield f"index.md: {wanted} is {told}"


def printed(seed: str) -> str:
    """Return what the start page's command prints of a seed."""
    out = io.StringIO()
    argv = ["--port", f"sim:cat?seed={seed}", "--speed", "max", "--duration", "10", "-o", "table"]
    with contextlib.redirect_stdout(out):
        radard(argv)
    return out.getvalue()


def main() -> int:
    """Print what does not hold; return 1 if there is anything."""
    found = [line for check in (not_run, within_sentences, data, start_page) for line in check()]
    for line in found:
        print(line)
    print(f"blocks: {len(ALL)} of {len(PAGES)} pages, {len(found)} complaints")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
