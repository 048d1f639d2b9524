"""Pages of the documentation, cut into blocks of code and prose."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROGRAMS = ("radard", "x2radar", "train-export")
FIRST_WORDS = {
    *PROGRAMS,
    "./run",
    "./test",
    "python",
    "pip",
    "sudo",
    "curl",
    "systemctl",
    "mkdocs",
}
PAGES = sorted(
    path
    for pattern in ("README.md", "CONTRIBUTING.md", "docs/**/*.md", "deploy/*.md")
    for path in ROOT.glob(pattern)
)
_MARK = re.compile(r"<!-- not run: (.+) -->")


@dataclass(frozen=True)
class Block:
    """A block of code; `reason` is why it is not run as it is, empty where it is.

    A reason may say how it is tried instead: "takes hours; tried with accept: --share 0.01" gives
    every command with the word `accept` these options as well. Others are then left out.
    """

    page: str
    line: int
    kind: str
    text: str
    reason: str

    @property
    def name(self) -> str:
        """Where it stands."""
        return f"{self.page}:{self.line}"

    def tried(self) -> Iterator[str]:
        """Yield commands with what makes them short; none if the reason names nothing."""
        _, _, how = self.reason.partition("; tried with ")
        options = dict(part.split(": ", 1) for part in how.split("; ")) if how else {}
        for command in self.commands():
            more = [given for word, given in options.items() if word in command]
            if more:
                yield " ".join([command, *more])

    def commands(self) -> list[str]:
        """Return commands of a shell block: continued lines joined, comments left out."""
        joined = re.sub(r"\\\n\s*", " ", self.text)
        lines = (re.sub(r"(^|\s+)#\s.*$", "", line).strip() for line in joined.splitlines())
        return [line for line in lines if line]


def blocks_of(path: Path) -> Iterator[Block]:
    """Yield every block of code of a page: fenced, or indented and begun with a command."""
    lines = path.read_text("utf-8").splitlines()
    page = str(path.relative_to(ROOT))
    reason, k = "", 0
    while k < len(lines):
        line = lines[k]
        fence = re.match(r"( *)(```+)(\w*)", line)
        words = line.split()
        begins = line.startswith("    ") and (k == 0 or not lines[k - 1].strip())
        if fence:
            end = next(n for n in range(k + 1, len(lines)) if lines[n].strip() == fence[2])
            indent = len(fence[1])
            text = "\n".join(each[indent:] for each in lines[k + 1 : end])
            yield Block(page, k + 1, fence[3], text, reason)
            k, reason = end, ""
        elif begins and words and words[0] in FIRST_WORDS:
            end = k
            while end < len(lines) and lines[end].startswith("    "):
                end += 1
            yield Block(page, k + 1, "sh", "\n".join(x[4:] for x in lines[k:end]), reason)
            k, reason = end, ""
        elif mark := _MARK.search(line):
            reason = mark[1]
        elif words:
            reason = ""
        k += 1


def inline_commands(path: Path) -> Iterator[list[str]]:
    """Yield commands of our programs within a sentence or a table, as lists of words."""
    text = re.sub(r"^ *```.*?^ *```", "", path.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    for quoted in re.findall(r"`([^`]+)`", text):
        flat = " ".join(quoted.replace("\\|", "|").split())
        if flat.startswith(tuple(f"{name} " for name in PROGRAMS)) and "..." not in flat:
            yield shlex.split(flat)
