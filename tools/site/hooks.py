"""What mkdocs runs while it builds the site: parts of pages that are made from the program.

A line `<!-- generated: NAME -->` of a page becomes what `reference.PARTS[NAME]` returns. A link to
a file outside docs/ becomes the file's name. Notebooks become pages, with a link to the file.
"""

import json
import re
from pathlib import Path
from typing import Any

import reference
from mkdocs.structure.files import File, Files

_MARK = re.compile(r"^<!-- generated: ([\w-]+) -->$", re.MULTILINE)


def on_files(files: Files, *, config: Any) -> Files:
    """Add a page for every notebook."""
    for file in list(files):
        if file.src_uri.endswith(".ipynb"):
            text = _page_of(Path(file.abs_src_path))
            name = file.src_uri.removesuffix(".ipynb")
            files.append(File.generated(config, f"{name}.md", content=text))
    return files


def _page_of(notebook: Path) -> str:
    """Return the cells of a notebook and what they have shown as a page."""
    parts = []
    for cell in json.loads(notebook.read_text("utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
        parts += [_shown(output) for output in cell.get("outputs", ())]
    parts.insert(1, f"[The notebook as a file](<{notebook.name}>); `jupyter lab` runs it.")
    return "\n\n".join(parts) + "\n"


def _shown(output: Any) -> str:
    """Return an output of a cell, as tools/notebooks.py keeps it."""
    data = output.get("data", {})
    if "image/png" in data:
        return (
            f"![What the cell draws](data:image/png;base64,{''.join(data['image/png']).strip()})"
        )
    return f"```text\n{''.join(output.get('text') or data['text/plain']).rstrip()}\n```"


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return a page's text with its generated parts in place."""
    # So many `..` lead from the page's folder to docs/; one more leaves it.
    up = re.escape("../" * page.file.src_uri.count("/"))
    outside = re.compile(rf"\[([^\]]+)\]\({up}\.\./(?!\.\.)([\w./-]+)(?:#[\w-]+)?\)")
    text = outside.sub(_named, markdown)
    if not page.file.src_uri.startswith("notebooks/"):
        text = re.sub(r"(\]\([\w./-]+)\.ipynb\)", r"\1.md)", text)
    return _MARK.sub(lambda match: reference.PARTS[match[1]](), text)


def _named(link: re.Match[str]) -> str:
    """Return the text of a link to a file of the source, with the file's name."""
    return f"`{link[2]}`" if link[1] == link[2] else f"{link[1]} (`{link[2]}` in the source)"
