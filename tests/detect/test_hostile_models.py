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


def network(change=None):
    """A small network as bytes, its model changed in place."""
    weights = helper.make_tensor("w", TensorProto.FLOAT, [1], [1.0])
    node = helper.make_node("Add", ["x", "w"], ["y"])
    value = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1]) for n in "xy"]
    model = helper.make_model(helper.make_graph([node], "g", value[:1], value[1:], [weights]))
    if change is not None:
        change(model)
    return model.SerializeToString()


def external(model, tensor=None):
    tensor = tensor or model.graph.initializer[0]
    tensor.external_data.add(key="location", value="/etc/passwd")


def elsewhere(model, tensor=None):
    tensor = tensor or model.graph.initializer[0]
    tensor.data_location = TensorProto.EXTERNAL


def foreign(model):
    model.graph.node[0].domain = "com.evil"


def constant(change):
    """A node of which the attribute holds a tensor that is changed."""

    def make_it(model):
        tensor = helper.make_tensor("c", TensorProto.FLOAT, [1], [1.0])
        change(model, tensor)
        model.graph.node.append(helper.make_node("Constant", [], ["c"], value=tensor))

    return make_it


TWICE = helper.make_node("Twice", ["x"], ["y"], domain="my.ops")


def branch(model):
    inner = helper.make_graph([TWICE], "i", [], [])
    node = helper.make_node("If", ["b"], ["y"], then_branch=inner, else_branch=inner)
    model.graph.node.append(node)


def sparse(model):
    values = helper.make_tensor("v", TensorProto.FLOAT, [1], [1.0])
    elsewhere(model, values)
    indices = helper.make_tensor("i", TensorProto.INT64, [1], [0])
    model.graph.sparse_initializer.append(helper.make_sparse_tensor(values, indices, [4]))


def function(model):
    opsets = [helper.make_opsetid("", 20)]
    model.functions.append(helper.make_function("f", "F", ["x"], ["y"], [TWICE], opsets))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (external, "another file"),
        (elsewhere, "another file"),
        (constant(external), "another file"),
        (constant(elsewhere), "another file"),
        (sparse, "another file"),
        (foreign, "an operator of the domain 'com.evil'"),
        (branch, "an operator of the domain 'my.ops'"),
        (function, "an operator of the domain 'my.ops'"),
    ],
)
def test_networks_with_more_than_their_hash_covers(tmp_path, change, words):
    data = network(change)
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
