"""Hostile MATLAB, NumPy and SigMF files: refused in one line, nothing unpickled."""

import json
import pickle
import re
import struct
import zipfile

import pytest

from tests.hostile_helpers import ROOT, limited_worker, refused
from tests.recording_helpers import run
from x2radar.recording.registry import open_recording

pytestmark = pytest.mark.integration
worker = pytest.fixture(scope="module")(limited_worker)


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data.ljust(-(-len(data) // 8) * 8, b"\0")


def mat_of(kind, n, names=b"scn\0"):
    """A MATLAB file with an array `scn` of some class, said to have n elements."""
    names = struct.pack("<HHI", 5, 4, 4) + element(1, names) if kind == 2 else b""
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


@pytest.mark.parametrize("names", [b"", b"xyz\0", b"x\0\0\0" * (1 << 22)])
def test_a_struct_of_no_field_that_is_wanted_costs_nothing(tmp_path, worker, names):
    """Found by fuzzing: without a field every one of 2^31 elements was made of nothing."""
    data = mat_of(2, (1 << 31) - 1, names)
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
