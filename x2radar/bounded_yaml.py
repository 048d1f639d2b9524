"""YAML, read with bounds: a few lines of it may stand for more than any memory holds."""

from typing import Any

import yaml

_MOST_CHARACTERS = 1 << 18
"""Of a document. Chosen: fifty times the longest scene or configuration here."""
_MOST_NODES = 50_000
"""With aliases written out. Chosen likewise."""
_MOST_SCALAR = 10_000
"""Characters of one value. Chosen: a base-60 integer costs the square of its length."""


def compose_yaml(text: str) -> yaml.Node | None:
    """Return the node tree of a YAML document; None of an empty one.

    Raises yaml.YAMLError, ValueError or RecursionError if it is not YAML, or longer or deeper,
    with aliases written out, than any scene or configuration.
    """
    if len(text) > _MOST_CHARACTERS:
        msg = f"{len(text)} characters, at most {_MOST_CHARACTERS} are read"
        raise ValueError(msg)
    node: yaml.Node | None = yaml.compose(text, yaml.SafeLoader)
    if node is not None:
        _count(node, {}, set())
    return node


def load_yaml(text: str) -> Any:
    """Return what a YAML document says, as `yaml.safe_load` does; raises as `compose_yaml`."""
    return construct(compose_yaml(text))


def construct(node: yaml.Node | None) -> Any:
    """Return what a node of `compose_yaml` says; raises as that."""
    if node is None:
        return None
    # The constructor alone, without a text to scan.
    loader = yaml.SafeLoader("")
    try:
        return loader.construct_document(node)
    except (TypeError, AttributeError, OverflowError, KeyError, IndexError) as err:
        # What PyYAML makes of tags on values that they do not suit.
        msg = f"a tag that does not suit its value ({type(err).__name__})"
        raise ValueError(msg) from err
    finally:
        loader.dispose()


def _count(node: yaml.Node, known: dict[int, int], above: set[int]) -> int:
    """Return the nodes of a tree with aliases written out."""
    if id(node) in known:
        return known[id(node)]
    if id(node) in above:
        msg = "an alias to what it stands in"
        raise ValueError(msg)
    if isinstance(node, yaml.ScalarNode) and len(node.value) > _MOST_SCALAR:
        msg = f"a value of {len(node.value)} characters"
        raise ValueError(msg)
    above.add(id(node))
    n = 1
    if isinstance(node, yaml.SequenceNode):
        n += sum(_count(item, known, above) for item in node.value)
    elif isinstance(node, yaml.MappingNode):
        n += sum(_count(item, known, above) for pair in node.value for item in pair)
    above.discard(id(node))
    if n > _MOST_NODES:
        msg = f"more than {_MOST_NODES} values, with aliases written out"
        raise ValueError(msg)
    known[id(node)] = n
    return n
