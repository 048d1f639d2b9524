"""What mkdocs runs while it builds the site: parts of pages that are made from the program.

A line `<!-- generated: NAME -->` of a page becomes what `reference.PARTS[NAME]` returns. A link to
a file outside docs/ becomes the file's name.
"""

import re
from typing import Any

import reference

_MARK = re.compile(r"^<!-- generated: ([\w-]+) -->$", re.MULTILINE)


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return a page's text with its generated parts in place."""
    # So many `..` lead from the page's folder to docs/; one more leaves it.
    up = re.escape("../" * page.file.src_uri.count("/"))
    outside = re.compile(rf"\[([^\]]+)\]\({up}\.\./(?!\.\.)([\w./-]+)(?:#[\w-]+)?\)")
    text = outside.sub(_named, markdown)
    return _MARK.sub(lambda match: reference.PARTS[match[1]](), text)


def _named(link: re.Match[str]) -> str:
    """Return the text of a link to a file of the source, with the file's name."""
    return f"`{link[2]}`" if link[1] == link[2] else f"{link[1]} (`{link[2]}` in the source)"
