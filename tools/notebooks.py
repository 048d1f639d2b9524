"""Run the notebooks of docs/notebooks and keep what they show: `tools/notebooks.py [NAME ...]`.

Pictures are kept with 64 colours, which is a third of their bytes.
"""

import base64
import io
import os
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

ROOT = Path(__file__).parents[1]
NOTEBOOKS = ROOT / "docs" / "notebooks"
_KEPT = ("image/png", "text/plain")
_CELL_S = 1800


def run(path: Path) -> nbformat.NotebookNode:
    """Return a notebook after a run in an empty folder, with its outputs as they are kept."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        where = {"metadata": {"path": folder}}
        client = NotebookClient(notebook, timeout=_CELL_S, kernel_name="python3", resources=where)
        client.execute()
    notebook.metadata.language_info = {"name": "python"}
    for cell in notebook.cells:
        cell.metadata.clear()
        if cell.cell_type == "code":
            cell.execution_count = None
            cell.outputs = _kept(cell.outputs)
    return notebook


def _kept(outputs: list[nbformat.NotebookNode]) -> list[nbformat.NotebookNode]:
    """Return outputs with text of one stream in one piece and small pictures."""
    kept: list[nbformat.NotebookNode] = []
    for each in outputs:
        if each.output_type == "stream":
            same = next((one for one in kept if one.get("name") == each.name), None)
            if same is not None:
                same.text += each.text
                continue
        else:
            kind = next(kind for kind in _KEPT if kind in each.data)
            text = each.data[kind]
            each.data = nbformat.from_dict({kind: _small(text) if kind == _KEPT[0] else text})
            each.metadata = nbformat.from_dict({})
            if "execution_count" in each:
                each.execution_count = None
        kept.append(each)
    return kept


def _small(png: str) -> str:
    image = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")
    made = io.BytesIO()
    image.quantize(64, dither=Image.Dither.NONE).save(made, "PNG", optimize=True)
    return base64.b64encode(made.getvalue()).decode()


def main() -> int:
    """Run those that are named, or all."""
    folders = [str(ROOT), str(ROOT / "daemon"), str(ROOT / "training")]
    os.environ["PYTHONPATH"] = os.pathsep.join(folders)
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        if not sys.argv[1:] or path.stem in sys.argv[1:]:
            text = nbformat.writes(run(path), indent=1)
            path.write_text(text.rstrip("\n") + "\n", "utf-8")
            print(f"{path.name}: {len(text)} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
