"""Every `>>>` of the three packages is run; those of what users call are enough to learn from."""

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = {"x2radar": ROOT, "radard": ROOT / "daemon", "x2train": ROOT / "training"}
LEAST = 30


def _modules():
    for package, folder in PACKAGES.items():
        for path in sorted((folder / package).rglob("*.py")):
            if ">>> " in path.read_text("utf-8"):
                parts = path.relative_to(folder).with_suffix("").parts
                yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = list(_modules())


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    done = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert done.failed == 0, capsys.readouterr().out
    found = doctest.DocTestFinder().find(module)
    assert any(each.examples for each in found), f"{name}: no docstring holds its example"


def test_there_are_enough_of_them_in_every_package():
    finder = doctest.DocTestFinder()
    counted = dict.fromkeys(PACKAGES, 0)
    for name in MODULES:
        for found in finder.find(importlib.import_module(name)):
            is_public = not any(part.startswith("_") for part in found.name.split("."))
            run = [e for e in found.examples if doctest.SKIP not in e.options]
            counted[name.partition(".")[0]] += len(run) if is_public else 0
    assert sum(counted.values()) >= LEAST
    assert all(counted.values()), counted


@pytest.mark.parametrize(
    "name", ["x2radar.open", "radard.classify", "radard.features", "radard.spectrogram"]
)
def test_what_people_call_has_an_example(name):
    package, _, thing = name.partition(".")
    api = importlib.import_module("radard.api" if package == "radard" else package)
    module_doc = importlib.import_module(package).__doc__ or ""
    assert ">>>" in (getattr(api, thing).__doc__ or "") or f"{name}(" in module_doc
