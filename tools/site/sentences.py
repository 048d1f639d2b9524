"""Print how long the sentences of each page are: the median, the longest, and how many words.

python tools/site/sentences.py [PAGE ...]
"""

import statistics
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.docs_helpers import PAGES, prose_of  # noqa: E402 - the test's own way to cut a page


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
