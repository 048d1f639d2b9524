"""Damaged and hostile files: refused in one line, in bounded time and memory, nothing executed."""

import hashlib
import json
import pickle
import re
import struct
import subprocess
import sys
import warnings
import zipfile
from pathlib import Path

import h5py
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from campaigns import fuzz
from campaigns.fuzz_mutate import BORDER
from campaigns.fuzz_targets import TARGETS
from radard.alarm.state_store import StateStore
from radard.classify.bundle import bundle_names, load_bundle
from radard.classify.onnx_safety import unsafe_in
from radard.config.config import load_config
from radard.detect.calibration import load_calibration
from radard.errors import ConfigError, ModelMismatch
from tests.radar_helpers import BASEBAND, frames_of, noise
from tests.recording_helpers import make, run
from x2radar.errors import RecordingError, SceneError
from x2radar.frame import StreamInfo
from x2radar.recording.hdf5_file import lookup3
from x2radar.recording.hdf5_reader import RecordingReader
from x2radar.recording.hdf5_writer import RecordingWriter
from x2radar.recording.registry import open_recording
from x2radar.sim.scene.scene import load_scene

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def worker(tmp_path_factory):
    """A process with the campaign's limits of time and memory."""
    worker = fuzz.Worker(("hdf5", "p4xx", "npz"), tmp_path_factory.mktemp("worker"))
    yield worker
    worker.close()


def read(path):
    with open_recording(path) as reader:
        _ = reader.labels
        for _ in reader.blocks():
            pass


def refused(path):
    """The one line that a recording is refused with."""
    with pytest.raises(RecordingError) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# ---------------------------------------------------------------- HDF5: damage


def killed(path, n=200):
    """A recording whose writer was killed, as its bytes: all is there but a close."""
    code = (
        "import os, sys; sys.path[:0] = ['.', 'daemon']\n"
        "from tests.radar_helpers import BASEBAND, frames_of, noise\n"
        "from x2radar.frame import StreamInfo\n"
        "from x2radar.recording.hdf5_writer import RecordingWriter\n"
        "writer = RecordingWriter(sys.argv[1], StreamInfo(BASEBAND, 60, 'x'))\n"
        f"for frame in frames_of(noise({n})): writer.write(frame)\n"
        "os._exit(9)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], cwd=ROOT, check=False)
    assert done.returncode == 9
    return path.read_bytes()


@pytest.mark.parametrize("is_closed", [True, False])
def test_a_flipped_bit_of_metadata_hangs_nothing(tmp_path, worker, is_closed):
    """SWMR reads, which were used before, repeat each read with a wrong checksum for minutes."""
    path = tmp_path / "w.h5"
    whole = make(path)[0].read_bytes() if is_closed else killed(path)
    marks = [m.start() for m in re.finditer(rb"OHDR|OCHK|EAHD|EAIB|EADB|FRHP|GCOL", whole)]
    places = sorted({20, *(mark + k for mark in marks[:12] for k in (1, 9, 30))})
    for at in places:
        data = bytearray(whole)
        data[at] ^= 0x10
        assert worker.run("hdf5", bytes(data)) == ("fine", ""), at


def test_a_killed_recording_is_read_whole_with_a_warning(tmp_path):
    path = tmp_path / "k.h5"
    killed(path)
    with pytest.raises(OSError, match="already open for write"):
        h5py.File(path)
    with open_recording(path) as reader:
        assert (reader.n_frames, reader.labels) == (180, [])
        assert "is being written, or was cut off; 180 whole frames are read" in reader.warning
        got = np.array([frame.samples for frame in reader.frames()])
    assert np.array_equal(got, noise(200)[:180])


def test_a_killed_recording_that_nobody_closes_does_not_crash_at_the_end(tmp_path):
    path = tmp_path / "k.h5"
    killed(path)
    code = (
        "import sys; from x2radar.recording.registry import open_recording\n"
        "reader = open_recording(sys.argv[1]); print(next(reader.frames()).counter)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], cwd=ROOT, capture_output=True, check=False
    )
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, b"1", b"")


def test_a_recording_is_read_while_it_is_written(tmp_path):
    path = tmp_path / "w.h5"
    samples = noise(600)
    seen = []
    with RecordingWriter(path, StreamInfo(BASEBAND, 60, "x")) as writer:
        for frame in frames_of(samples):
            writer.write(frame)
            if frame.index % 100 == 99:
                with RecordingReader(path) as reader:
                    got = np.array([f.samples for f in reader.frames()])
                assert np.array_equal(got, samples[: len(got)])
                seen.append(len(got))
    assert seen == [60, 180, 300, 360, 480, 600]
    with RecordingReader(path) as reader:
        assert (reader.n_frames, reader.warning) == (600, None)


def test_the_checksum_of_hdf5s_metadata(tmp_path):
    # The last line of the comment in Jenkins' lookup3.c, driver5().
    assert lookup3(b"Four score and seven years ago") == 0x17770551
    head = make(tmp_path / "w.h5")[0].read_bytes()[:48]
    assert lookup3(head[:44]) == struct.unpack("<I", head[44:])[0]
    assert lookup3(b"") == 0xDEADBEEF


def test_a_heap_that_does_not_add_up_is_refused_by_us(tmp_path, worker):
    """HDF5 2.0 goes in a circle over an object of the size 2^64 - 1, and holds the GIL."""
    path, _ = make(tmp_path / "w.h5")
    data = bytearray(path.read_bytes())
    at = data.index(b"GCOL\x01") + 16
    for size in (0x7FC000000018, (1 << 64) - 1, (1 << 64) - 16, 1 << 20):
        struct.pack_into("<Q", data, at + 8, size)
        assert worker.run("hdf5", bytes(data)) == ("fine", "")
        path.write_bytes(data)
        assert "a heap of texts that does not add up" in refused(path)


# ---------------------------------------------------------------- HDF5: hostile structure


def plain(path, change):
    """A recording of another program, without checksums, changed."""
    ours, _ = make(path.with_name("ours.h5"))
    with h5py.File(ours) as source, h5py.File(path, "w") as file:
        file.attrs.update(source.attrs)
        for name in ("samples", "counter", "t_s"):
            file[f"frames/{name}"] = source[f"frames/{name}"][()]
        change(file)
    return path


def put(name, **options):
    def change(file):
        file.pop(name, None)
        if "link" in options:
            file[name] = options["link"]
        else:
            file.create_dataset(name, **options)

    return change


def virtual(file):
    del file["frames/samples"]
    layout = h5py.VirtualLayout((40, 64), "c8")
    layout[:] = h5py.VirtualSource("secret.h5", "x", (40, 64))
    file.create_virtual_dataset("frames/samples", layout)


def long_text(file):
    """Ten thousand labels that share one text of a megabyte."""
    text = h5py.string_dtype()
    file["labels/t0_s"] = file["labels/t1_s"] = np.zeros(9000)
    labels = file.create_dataset("labels/label", 9000, text)
    labels[:] = "x"
    labels[0] = "y" * 4_300_000


ANY = (None, None)
S, HUGE = "frames/samples", {"dtype": "c8", "chunks": (60, 64), "compression": "gzip"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put(S, link=h5py.ExternalLink("secret.h5", "/x")), "is a link to elsewhere"),
        (put("frames", link=h5py.ExternalLink("secret.h5", "/x")), "is a link to elsewhere"),
        (put(S, link=h5py.SoftLink("/frames/samples")), "is a link to elsewhere"),
        (put(S, shape=(40, 64), dtype="c8", external=[("secret.h5", 0, 20480)]), "other files"),
        (virtual, "lies in other files"),
        (put(S, shape=(1 << 33, 64), **HUGE), "which the file cannot hold"),
        (put(S, shape=(1 << 33, 64), dtype="c8"), "which the file cannot hold"),
        (put(S, shape=(40, 1 << 20), dtype="c8", chunks=(1, 64)), "cannot hold"),
        (put(S, shape=(40, 20_000), **HUGE | {"chunks": (1, 64)}), "shape"),
        (
            put(S, shape=(10, 2**10), **HUGE | {"chunks": (2**10, 2**14)}, maxshape=ANY),
            "chunks of",
        ),
        (put(S, shape=(40, 64), dtype="c8", chunks=(1, 64), scaleoffset=None), None),
        (put(S, shape=(40, 64), dtype="i4", chunks=(1, 64), scaleoffset=3), "packed by"),
        (put("frames/counter", shape=1 << 40, dtype="u4", chunks=1 << 28), "cannot hold"),
        (put("frames/counter", data=[b"a"] * 40), "no list of numbers"),
        (put("frames/t_s", shape=40, dtype=h5py.ref_dtype), "no list of numbers"),
        (put("labels", data=[1]), "/labels lacks"),
        (long_text, "of more text"),
        (lambda file: file.attrs.create("device", file.ref, dtype=h5py.ref_dtype), "no text"),
        (lambda file: file.attrs.create("device", ["a"] * 9), "no text and no number"),
        (lambda file: file.attrs.create("kind", h5py.Empty("f4")), "damaged"),
        (lambda file: file.attrs.create("carrier_hz", np.zeros(9)), "no text and no number"),
        (lambda file: file.attrs.create("settings", "[" * 50_000), "RecursionError"),
    ],
)
def test_hostile_hdf5(tmp_path, worker, change, words):
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["x"] = np.full((40, 64), 7, "c8")
    path = plain(tmp_path / "a.h5", change)
    assert path.stat().st_size < 5_000_000
    if words is None:
        assert open_recording(path).n_frames == 40
        return
    assert worker.run("hdf5", path.read_bytes()) == ("fine", "")
    assert words in refused(path)


def test_a_recording_without_offsets_of_8_bytes_or_with_bytes_before_it(tmp_path):
    whole = make(tmp_path / "w.h5")[0].read_bytes()
    for data in (bytes(512) + whole, whole[:9] + b"\4" + whole[10:], b""):
        (tmp_path / "a.h5").write_bytes(data)
        assert "not an HDF5 file, or damaged" in refused(tmp_path / "a.h5")


# ---------------------------------------------------------------- MATLAB, NumPy, SigMF


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data.ljust(-(-len(data) // 8) * 8, b"\0")


def mat_of(kind, n):
    """A MATLAB file with an array `scn` of some class, said to have n elements."""
    names = struct.pack("<HHI", 5, 4, 4) + element(1, b"scn\0") if kind == 2 else b""
    head = element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack("<ii", 1, n))
    body = element(14, head + element(1, b"scn") + names)
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + body


@pytest.mark.parametrize("n", [3, (1 << 31) - 1, -1])
@pytest.mark.parametrize("kind", [1, 2, 4, 5, 6])
def test_a_mat_file_that_says_more_than_it_holds(tmp_path, worker, kind, n):
    """Of 216 bytes a list of 2^31 empty elements was made, 85 MB a second."""
    data = mat_of(kind, n)
    assert len(data) < 217
    assert worker.run("p4xx", data) == ("fine", "")
    (tmp_path / "a.mat").write_bytes(data)
    assert str(tmp_path / "a.mat") in refused(tmp_path / "a.mat")


class Boom:
    def __reduce__(self):
        return exec, ("raise SystemExit('a file was executed')",)


def archive(path, **members):
    """A NumPy archive of bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(f"{name}.npy", data)
    return path


def npy(shape, descr="<c8", data=b""):
    head = repr({"descr": descr, "fortran_order": False, "shape": shape}).encode().ljust(117)
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(head) + 1) + head + b"\n" + data


GOOD = npy((40, 8), data=bytes(40 * 64))
NUMBERS = {
    name: npy((), "<f8", struct.pack("<d", 60.0))
    for name in ("frame_rate_hz", "carrier_hz", "bin_length_m")
}


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({"samples": npy((40, 8), "|O", pickle.dumps(Boom()))}, "no frames"),
        ({"samples": GOOD, "device": npy((), "|O", pickle.dumps(Boom()))}, "is object"),
        ({"samples": GOOD, "counter": npy((40,), "|O", pickle.dumps(Boom()))}, "is object"),
        ({"samples": npy((1 << 40, 8))}, "cut off"),
        ({"samples": npy((-40, 8))}, "shape"),
        ({"samples": npy((40, 1 << 20))}, "shape"),
        ({"samples": GOOD, "counter": bytes(1 << 28)}, "too much"),
        ({"samples": GOOD, "device": bytes(1 << 28)}, "too much"),
        ({"samples": GOOD, "t_s": npy((1 << 40,), "<f8")}, "which is not read"),
        ({"samples": b"\x93NUMPY\2\0" + b"\xff" * 4 + bytes(1 << 27)}, "header of"),
        ({"samples": GOOD, "labels_t0_s": npy((1 << 50,), "<f8")}, "which is not read"),
    ],
)
def test_hostile_archives(tmp_path, worker, members, words):
    path = archive(tmp_path / "a.npz", **(NUMBERS | members))
    assert path.stat().st_size < 600_000
    assert worker.run("npz", path.read_bytes()) == ("fine", "")
    assert words in refused(path)


def test_other_members_of_an_archive_are_not_read(tmp_path):
    others = {"more": npy((), "|O", pickle.dumps(Boom())), "bomb": bytes(1 << 26)}
    path = archive(tmp_path / "a.npz", samples=GOOD, **NUMBERS, **others)
    assert open_recording(path).n_frames == 40


def test_nothing_is_ever_unpickled():
    # numpy.load and h5py do not unpickle unless they are told to.
    wanted = re.compile(
        r"allow_pickle\s*=\s*True|\bimport (?:pickle|marshal|shelve|dill)\b|yaml\.load\("
    )
    sources = [p for folder in ("x2radar", "daemon") for p in (ROOT / folder).rglob("*.py")]
    assert len(sources) > 100
    assert [str(path) for path in sources if wanted.search(path.read_text("utf-8"))] == []


@pytest.mark.parametrize(
    "change",
    [
        {"core:num_channels": 1 << 40},
        {"core:num_channels": True},
        {"core:num_channels": 1e9},
        {"core:datatype": ["cf32_le"] * 5000},
        {"core:sample_rate": "x" * 100_000},
        {"core:sample_rate": [1]},
        {"core:sample_rate": 10**400},
        {"x2radar:bin_length_m": {"a": 1}},
    ],
)
def test_sigmf_that_makes_no_sense(tmp_path, change):
    root = {
        "global": {"core:datatype": "cf32_le", "core:num_channels": 8, "core:sample_rate": 60}
        | {"x2radar:bin_length_m": 0.03}
        | change,
        "captures": [{"core:sample_start": 0, "core:frequency": 6.8e9}],
    }
    (tmp_path / "a.sigmf-data").write_bytes(bytes(640))
    (tmp_path / "a.sigmf-meta").write_text(json.dumps(root))
    assert len(refused(tmp_path / "a.sigmf-meta")) < 1200


@pytest.mark.parametrize(
    "note",
    [
        {"core:sample_start": "a", "core:label": "x"},
        {"core:label": "x", "x2radar:t_s": [1]},
        {"core:label": "x", "x2radar:t_s": ["a", "b"]},
    ],
)
def test_sigmf_labels_that_make_no_sense_are_one_line(tmp_path, capsys, note):
    about = {"core:datatype": "cf32_le", "core:num_channels": 8, "core:sample_rate": 60}
    root = {
        "global": about | {"x2radar:bin_length_m": 0.03},
        "captures": [{"core:sample_start": 0, "core:frequency": 6.8e9}],
        "annotations": [note],
    }
    (tmp_path / "a.sigmf-data").write_bytes(bytes(640))
    (tmp_path / "a.sigmf-meta").write_text(json.dumps(root))
    code, out, err = run(capsys, "info", tmp_path / "a.sigmf-meta")
    assert (code, out, err.count("\n")) == (66, "", 1)
    assert "internal error" not in err


# ---------------------------------------------------------------- YAML


LAUGHS = "".join(
    f"- &{chr(k + 1)} [*{chr(k)}, *{chr(k)}, *{chr(k)}, *{chr(k)}]\n" for k in range(97, 121)
)


@pytest.mark.parametrize(
    "text",
    [
        "steps:\n- body: human\n  duration_s:\n  - &a [x, x]\n" + LAUGHS.replace("- ", "  - "),
        "steps: &a [*a]\n",
        "? &a [*a]\n: 1\n",
        "steps: " + "[" * 5000,
        "steps: [{duration_s: 1" + ":1" * 6000 + "}]\n",
        "a: &a {b: 1}\nsteps: [{<<: [" + "*a, " * 60_000 + "*a]}]\n",
        "steps: !!binary 1\n",
        "steps: !!timestamp x\n",
        "steps: !!int ''\n",
        "steps: !!python/object/apply:os.system [true]\n",
        "steps: [{body: human, course: {a: 1}}]\n",
        "steps: [{body: human, duration_s: [[[1]], 2]}]\n",
        "like: [dog]\n",
        "x: 1\n" * 100_000,
    ],
)
def test_yaml_that_stands_for_more_than_it_is(tmp_path, text):
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(SceneError) as scene:
        load_scene(str(path))
    with pytest.raises(ConfigError) as config:
        load_config(path, environ={})
    for caught in (scene, config):
        assert len(str(caught.value)) < 1500
        assert str(path) in str(caught.value)


# ---------------------------------------------------------------- bundles


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


# ---------------------------------------------------------------- calibrations and kept state


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("60.0", "1" + "0" * 400),
        ("60.0", "1e999"),
        ("60.0", "[" * 3000 + "]" * 3000),
        ("-60.0", "1e300"),
        ("-60.0", "9" * 100),
        ('"provenance"', "9"),
        ("600", '"' + "x" * 5000 + '"'),
        ("2026-02-01T12:00:00Z", "9999-99-99"),
    ],
)
def test_calibrations_that_make_no_sense(tmp_path, before, after):
    text = TARGETS["calibration"].seeds(tmp_path)[1].decode()
    assert before in text
    (tmp_path / "a.json").write_text(text.replace(before, after, 1))
    with pytest.raises(ConfigError) as caught:
        load_calibration(tmp_path / "a.json")
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(
    "text",
    [
        '{"is_armed": true, "alarm_peak": 1' + "0" * 400 + "}",
        '{"is_armed": true, "alarm_peak": ' + "[" * 3000 + "]" * 3000 + "}",
        "[" * 100_000,
        "[1]",
        "7",
        '{"is_armed": true, "alarm_peak": {}}',
    ],
)
def test_kept_state_that_makes_no_sense_is_not_used(tmp_path, caplog, text):
    (tmp_path / "state.json").write_text(text)
    kept = StateStore(tmp_path / "state.json").load(is_armed=True)
    assert (kept.is_armed, kept.alarm_id) == (True, None)
    assert "unreadable and not used" in caplog.text


# ---------------------------------------------------------------- the campaign itself


def test_the_short_campaign_finds_nothing(tmp_path):
    done = subprocess.run(
        [sys.executable, "campaigns/fuzz.py", "--inputs", "40", "--keep", str(tmp_path / "found")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout.splitlines()[-1])
    targets = summary.pop("targets")
    assert summary == {"inputs": 40 * len(TARGETS), "unhandled": 0, "hangs": 0, "over_memory": 0}
    assert list(targets) == list(fuzz.TARGETS) == list(TARGETS)
    assert not (tmp_path / "found").exists()


def test_good_inputs_are_read(tmp_path):
    """The campaign begins with files that reach far into the readers."""
    for name, target in TARGETS.items():
        folder = tmp_path / name
        (folder / "seeds").mkdir(parents=True)
        (folder / "work").mkdir()
        seeds = target.seeds(folder / "seeds")
        good = seeds[2] if name == "scene" else seeds[0]
        with warnings.catch_warnings():
            target.run(folder / "work", good)


def test_what_goes_wrong_is_counted_and_kept(tmp_path):
    """Inputs that raise, hang, grow and kill their process, by a target that does all that."""
    code = (
        "import os, sys; sys.path[:0] = ['.', 'daemon']\n"
        "from campaigns import fuzz, fuzz_targets\n"
        "def run(folder, data): exec(data)\n"
        "bad = fuzz_targets.Target('bad', run, lambda folder: [b'pass'])\n"
        "fuzz_targets.TARGETS = {'bad': bad}\n"
        "fuzz.main()\n"
    )
    (tmp_path / "bad.py").write_text(code)
    worker = fuzz.Worker(("bad",), tmp_path, program=str(tmp_path / "bad.py"))
    campaign = fuzz.Campaign(tmp_path / "found", worker)
    inputs = [
        b"pass",
        b"from x2radar.errors import SceneError; raise SceneError('as it should be')",
        b"raise KeyError(1)",
        b"while True: pass",
        b"import os; os.abort()",
        b"x = bytearray(600 << 20)",
        b"pass",
    ]
    try:
        campaign.feed("bad", iter(inputs))
    finally:
        worker.close()
    assert campaign.summary()["targets"]["bad"] == {
        "inputs": 7,
        "unhandled": 2,
        "hangs": 1,
        "over_memory": 1,
    }
    assert sorted(path.read_bytes() for path in (tmp_path / "found").iterdir()) == sorted(
        inputs[2:6]
    )


def test_the_same_seed_makes_the_same_inputs():
    def inputs(seed):
        seeds = [b"one: 1\n", b"\x89HDF\0\0" * 20 + BORDER + b"two"]
        return list(fuzz.mutations("scene", seed, 200, float("inf"), seeds))

    assert inputs(1) == inputs(1) != inputs(2)
