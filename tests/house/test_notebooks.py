"""The notebooks of docs/notebooks: they run from first to last cell, and show what is kept."""

import os
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

pytestmark = pytest.mark.nightly
ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
_CELL_S = 600
"""For one cell, on a machine that does much else."""


def read(path):
    return nbformat.read(path, as_version=4)


def kinds(cell):
    """What kinds of output a cell has."""
    return {each.get("name") or min(each.data) for each in cell.get("outputs", ())}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_it_runs(path, tmp_path, monkeypatch):
    folders = [str(ROOT), str(ROOT / "daemon"), str(ROOT / "training")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(folders))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    (tmp_path / "work").mkdir()
    notebook = read(path)
    client = NotebookClient(
        notebook,
        timeout=_CELL_S,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path / "work")}},
    )
    client.execute()
    # Pictures and words where those are that readers of the site see.
    assert [kinds(cell) for cell in notebook.cells] == [kinds(cell) for cell in read(path).cells]
    said = [out for cell in notebook.cells for out in cell.get("outputs", ())]
    assert said
    # A warning in a notebook is the first thing that a reader sees.
    assert not [out.text for out in said if out.get("name") == "stderr" and "arning" in out.text]
