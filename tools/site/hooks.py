"""What mkdocs runs while it builds the site: parts of pages that are made from the program.

A line `<!-- generated: NAME -->` of a page becomes what `reference.PARTS[NAME]` returns. Links that
leave docs/ (CONTRIBUTING.md, model cards, source) have no page: their text stays.
"""

import re
from collections.abc import Callable
from typing import Any

import reference

_MARK = re.compile(r"^<!-- generated: ([\w-]+) -->$", re.MULTILINE)
_OUTSIDE = re.compile(r"\[([^\]]+)\]\((?:\.\./)+(?!reference|research|docs)[\w./-]+(?:#[\w-]+)?\)")
_PAGES = {"docs/": "", "CONTRIBUTING.md": "contribute.md", "deploy/README.md": "install.md"}


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return a page's text with its generated parts in place."""

    def part(match: re.Match[str]) -> str:
        make: Callable[[], str] = reference.PARTS[match[1]]
        return make()

    depth = page.file.src_uri.count("/")
    text = _MARK.sub(part, markdown)
    # One `..` for each folder of the page leads to docs/; one more leaves it.
    outside = re.compile(r"\[([^\]]+)\]\((?:\.\./){%d}(?!\.\.)([\w./-]+)(?:#[\w-]+)?\)" % (depth + 1))
    return outside.sub(r"\1 (`\2`)", text)
