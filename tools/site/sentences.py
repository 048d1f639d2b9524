"""Print how long the sentences of each page are: the median, the longest, and how many words.

python tools/site/sentences.py [PAGE ...]
"""

import re
import statistics
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tools.pages import FIRST_WORDS, PAGES  # noqa: E402 - the path comes first

USER = (
    "index install mounting home-assistant troubleshooting how-it-decides what-stops-an-alarm "
    "accuracy glossary privacy contribute"
)
USER_PAGES = ["README.md", *(f"docs/{name}.md" for name in USER.split())]


def too_long() -> Iterator[str]:
    """Yield what is longer than people read: 20 words, or 40 in one sentence."""
    for page in USER_PAGES:
        lengths = [len(sentence.split()) for sentence in prose_of(ROOT / page)]
        if statistics.median(lengths) > 20 or max(lengths) > 40:
            yield f"{page}: sentences of {statistics.median(lengths):g} words, of {max(lengths)}"


def prose_of(path: Path) -> list[str]:
    """Return a page's sentences: without code, tables, headings, pictures, addresses of links."""
    text = path.read_text("utf-8")
    text = re.sub(r"^ *```.*?^ *```", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    kept: list[str] = []
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[*-]|\d+\.|\|) )", text):
        flat = " ".join(part.split())
        is_code = part.startswith("    ") and flat.split(" ")[0] in FIRST_WORDS
        if not flat or flat[0] in "#|!<" or is_code:
            continue
        flat = re.sub(r"^(?:[*-]|\d+\.|:) +", "", flat)
        flat = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", flat)
        flat = re.sub(r"`[^`]*`", "X", flat)
        kept += [s for s in re.split(r"(?<=[.!?])[*\"')]* +(?=[\"'(*A-Z0-9])", flat) if s.split()]
    return kept


def main(argv: list[str]) -> int:
    """Print a line for each page, and all of them together."""
    pages = [Path(name).resolve() for name in argv] or PAGES
    lengths = {page: [len(s.split()) for s in prose_of(page)] for page in pages}
    for page, of_page in lengths.items():
        print(_line(str(page.relative_to(ROOT)), of_page))  # noqa: T201 - a command
    print(_line("all", [n for of_page in lengths.values() for n in of_page]))  # noqa: T201
    return 0


def _line(name: str, lengths: list[int]) -> str:
    n = len(lengths)
    if not n:
        return f"{name:<36} no sentences"
    median, longest, words = statistics.median(lengths), max(lengths), sum(lengths)
    return (
        f"{name:<36} median {median:>4g}  longest {longest:>3}  {n:>4} sentences {words:>6} words"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
