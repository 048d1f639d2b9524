"""YAML, read with bounds: a few lines of it may stand for more than any memory holds.

A mapping that has a key twice is refused: PyYAML would drop the first of the two without a word.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

MAX_CHARACTERS = 1 << 18  # of a document: fifty times the longest scene or configuration here
MAX_NODES = 50_000  # with aliases written out, likewise
MAX_SCALAR = 10_000  # characters of one value: a base-60 integer costs the square of its length


class YamlError(ValueError):
    """A text that is not YAML, or more of it than is read; one line, without what stands there."""

    def __init__(self, problem: str, line: int | None = None) -> None:
        super().__init__(problem if line is None else f"line {line}: {problem}")
        self.problem = problem
        self.line = line  # counted from 1; None if it is of no line alone


def read_document(path: Path) -> str:
    """Return the text of a file, of one that is too long no more than shows that."""
    with path.open(encoding="utf-8-sig") as file:
        return file.read(MAX_CHARACTERS + 1)


def compose_yaml(text: str) -> yaml.Node | None:
    """Return the node tree of a YAML document, None of an empty one; or YamlError."""
    if len(text) > MAX_CHARACTERS:
        raise YamlError(f"longer than the {MAX_CHARACTERS} characters that are read")
    with _in_one_line():
        node: yaml.Node | None = yaml.compose(text, yaml.SafeLoader)
        if node is not None:
            _count(node, {})
        return node


def load_yaml(text: str) -> Any:
    """Return what a YAML document says, as `yaml.safe_load` does; raises as `compose_yaml`."""
    return construct(compose_yaml(text))


def construct(node: yaml.Node | None) -> Any:
    """Return what a node of `compose_yaml` says; raises YamlError for a value of no such kind."""
    if node is None:
        return None
    # The constructor alone, without a text to scan.
    with _in_one_line():
        return yaml.SafeLoader("").construct_document(node)


@contextlib.contextmanager
def _in_one_line() -> Iterator[None]:
    """Turn what PyYAML raises, of any kind, into YamlError."""
    try:
        yield
    except YamlError:
        raise
    except yaml.YAMLError as err:
        mark = getattr(err, "problem_mark", None)
        problem = " ".join(str(getattr(err, "problem", None) or err).split())
        raise YamlError(problem, mark.line + 1 if mark else None) from err
    except RecursionError as err:
        raise YamlError("nested too deeply") from err
    except (TypeError, AttributeError, ValueError, OverflowError, LookupError) as err:
        # What it makes of dates that do not exist, and of tags on values they do not suit.
        msg = f"a value that does not suit its tag or kind ({type(err).__name__})"
        raise YamlError(msg) from err


def _count(node: yaml.Node, known: dict[int, int]) -> int:
    """Return the nodes of a tree with aliases written out; look for keys that stand twice."""
    line = node.start_mark.line + 1
    if id(node) in known:
        if known[id(node)] == 0:
            raise YamlError("an alias to what it stands in", line)
        return known[id(node)]
    if isinstance(node, yaml.ScalarNode) and len(node.value) > MAX_SCALAR:
        raise YamlError(f"a value of {len(node.value)} characters", line)
    if isinstance(node, yaml.ScalarNode) and "\0" in node.value:
        raise YamlError("a NUL character, which no name or path may have", line)
    n, known[id(node)] = 1, 0
    if isinstance(node, yaml.SequenceNode):
        n += sum(_count(item, known) for item in node.value)
    elif isinstance(node, yaml.MappingNode):
        n += sum(_count(item, known) for pair in node.value for item in pair)
        _check_keys(node)
    if n > MAX_NODES:
        raise YamlError(f"more than {MAX_NODES} values, with aliases written out")
    known[id(node)] = n
    return n


def _check_keys(node: yaml.MappingNode) -> None:
    """Raise YamlError, naming both lines, if a mapping has a key twice, as it is written."""
    lines: dict[str, int] = {}
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            continue
        line = key.start_mark.line + 1
        if key.value in lines:
            name = key.value if len(key.value) <= 60 else f"{key.value[:60]}..."
            msg = f"the key '{name}' stands twice, in lines {lines[key.value]} and {line}"
            raise YamlError(" ".join(msg.split()), line)
        lines[key.value] = line
