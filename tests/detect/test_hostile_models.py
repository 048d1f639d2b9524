"""Networks with more in them than their hash covers, or than a network should hold."""

import hashlib
import json

import onnx
import pytest
from onnx import TensorProto, helper

from radard.errors import ModelMismatch
from radard.judge.bundle import bundle_names, load_bundle
from radard.judge.onnx_safety import unsafe_in
from tests.processes import ROOT


def network(**changes):
    """A small network as bytes; `tensor`, `node`, `graph` or `model` are changed in place."""
    weights = helper.make_tensor("w", TensorProto.FLOAT, [1], [1.0])
    node = helper.make_node("Add", ["x", "w"], ["y"])
    value = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1]) for n in "xy"]
    graph = helper.make_graph([node], "g", value[:1], value[1:], [weights])
    model = helper.make_model(graph)
    parts = {"tensor": graph.initializer[0], "node": graph.node[0], "graph": graph}
    for name, change in changes.items():
        change({**parts, "model": model}[name])
    if "tensor" in changes:
        model.graph.initializer[0].CopyFrom(parts["tensor"])
    model.graph.CopyFrom(graph)
    return model.SerializeToString()


def external(tensor):
    tensor.external_data.add(key="location", value="/etc/passwd")


def elsewhere(tensor):
    tensor.data_location = TensorProto.EXTERNAL


def foreign(node):
    node.domain = "com.evil"


def constant(change):
    """A node of which the attribute holds a tensor that is changed."""

    def make_it(graph):
        tensor = helper.make_tensor("c", TensorProto.FLOAT, [1], [1.0])
        change(tensor)
        graph.node.append(helper.make_node("Constant", [], ["c"], value=tensor))

    return make_it


def branch(graph):
    inner = helper.make_graph(
        [helper.make_node("Twice", ["x"], ["z"], domain="my.ops")], "i", [], []
    )
    graph.node.append(helper.make_node("If", ["b"], ["z"], then_branch=inner, else_branch=inner))


def sparse(graph):
    values = helper.make_tensor("v", TensorProto.FLOAT, [1], [1.0])
    elsewhere(values)
    indices = helper.make_tensor("i", TensorProto.INT64, [1], [0])
    graph.sparse_initializer.append(helper.make_sparse_tensor(values, indices, [4]))


def function(model):
    node = helper.make_node("Twice", ["x"], ["y"], domain="my.ops")
    opsets = [helper.make_opsetid("", 20)]
    model.functions.append(helper.make_function("f", "F", ["x"], ["y"], [node], opsets))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tensor": external}, "another file"),
        ({"tensor": elsewhere}, "another file"),
        ({"graph": constant(external)}, "another file"),
        ({"graph": constant(elsewhere)}, "another file"),
        ({"graph": sparse}, "another file"),
        ({"node": foreign}, "an operator of the domain 'com.evil'"),
        ({"graph": branch}, "an operator of the domain 'my.ops'"),
        ({"model": function}, "an operator of the domain 'my.ops'"),
    ],
)
def test_networks_with_more_than_their_hash_covers(tmp_path, changes, words):
    data = network(**changes)
    assert words in unsafe_in(data)
    # The same in a bundle whose hash is right.
    raw = json.loads((ROOT / "models" / "fast.json").read_bytes())
    raw["onnx_sha256"] = hashlib.sha256(data).hexdigest()
    (tmp_path / "a.json").write_text(json.dumps(raw))
    (tmp_path / "a.onnx").write_bytes(data)
    with pytest.raises(ModelMismatch, match="the network is refused"):
        load_bundle(str(tmp_path / "a.onnx"))


def test_networks_that_are_harmless_or_none():
    assert unsafe_in(network()) == ""
    for name in bundle_names():
        assert unsafe_in((ROOT / "models" / f"{name}.onnx").read_bytes()) == ""
    deep = b""
    for _ in range(100):
        deep = b"\x0a" + _length(b"\x2a" + _length(b"\x32" + _length(deep)))
    assert "deep" in unsafe_in(b"\x3a" + _length(deep))
    for data in (b"rubbish", b"\x3a\xff", b"\x3a" + b"\xff" * 20, network()[:-3], b"\x3b\x3c"):
        assert "no ONNX file" in unsafe_in(data)
    assert "own format" in unsafe_in(b"\x3a\x02\0\0ORTM")
    assert onnx.load_from_string(network())


def _length(data):
    n, out = len(data), bytearray()
    while n > 0x7F:
        out.append(n & 0x7F | 0x80)
        n >>= 7
    return bytes([*out, n]) + data
