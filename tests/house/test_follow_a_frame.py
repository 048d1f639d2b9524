"""follow-a-frame.md names files, functions and an order that hold; so does the pipeline's head."""

import ast
import importlib
import re
from pathlib import Path

import pytest

from radard import pipeline

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "research" / "follow-a-frame.md").read_text("utf-8")
ROWS = re.findall(r"^\| (\w) \|.*\| `([\w/.]+)` \| (.*) \|$", PAGE, re.MULTILINE)


def module_of(path):
    return importlib.import_module(
        path.removeprefix("daemon/").removesuffix(".py").replace("/", ".")
    )


@pytest.mark.parametrize(("number", "path", "functions"), ROWS)
def test_each_function_is_in_its_file(number, path, functions):
    for name in re.findall(r"`([\w.]+)`", functions):
        found = module_of(path)
        for part in name.split("."):
            found = getattr(found, part)
        assert callable(found)


def test_there_are_eight_files():
    assert [number for number, _, _ in ROWS] == [*"12345678", *"abcdefg"]


def test_the_functions_of_the_text_are_where_it_says():
    told = re.findall(r"`([A-Z]?\w+(?:\.\w+)?)` \(`([\w/.]+\.py)`\)", PAGE)
    assert len(told) >= 3
    for name, path in told:
        found = module_of(path)
        for part in name.split("."):
            found = getattr(found, part)


def test_the_pipeline_calls_its_parts_in_that_order():
    """By the lines of `decide` and of what it calls, in the order in which it calls them."""
    (tree,) = [
        node
        for node in ast.walk(ast.parse(Path(pipeline.__file__).read_text("utf-8")))
        if isinstance(node, ast.ClassDef) and node.name == "Pipeline"
    ]
    methods = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}

    def calls(name):
        found = [n for n in ast.walk(methods[name]) if isinstance(n, ast.Call)]
        # The inner call of an expression comes first, and ends first.
        for call in sorted(found, key=lambda n: (n.end_lineno, n.end_col_offset)):
            if not isinstance(call.func, ast.Attribute):
                continue
            own = isinstance(call.func.value, ast.Name) and call.func.value.id == "self"
            if own and call.func.attr in methods:
                yield from calls(call.func.attr)
            else:
                yield call.func.attr

    wanted = [functions.strip("`").split(".")[-1] for number, _, functions in ROWS[8:]]
    made = [name for name in calls("decide") if name in wanted]
    first = [name for k, name in enumerate(made) if name not in made[:k]]
    assert first == wanted


def test_the_modules_that_the_pipeline_names_are_there():
    names = re.findall(r"^    (x2radar\.[\w.]+|radard\.[\w.]+)", pipeline.__doc__, re.MULTILINE)
    assert len(names) == 15
    for name in names:
        importlib.import_module(name)
