"""Damaged and hostile HDF5 files: refused in one line, in bounded time and memory."""

import pickle
import re
import struct
import zipfile

import h5py
import numpy as np
import pytest

from campaigns import fuzz
from tests.processes import ROOT, ran
from tests.radar_helpers import BASEBAND, frames_of, noise
from tests.recording_helpers import make, refused
from x2radar.frame import StreamInfo
from x2radar.recording.hdf5_reader import RecordingReader, lookup3
from x2radar.recording.hdf5_writer import RecordingWriter
from x2radar.recording.registry import open_recording

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def worker(tmp_path_factory):
    """A process with the campaign's limits of time and memory."""
    made = fuzz.Worker(("hdf5", "p4xx", "npz"), tmp_path_factory.mktemp("worker"))
    yield made
    made.close()


def killed(path, n=200):
    """A recording whose writer was killed, as its bytes: all is there but a close."""
    code = (
        "import os, sys\n"
        "from tests.radar_helpers import BASEBAND, frames_of, noise\n"
        "from x2radar.frame import StreamInfo\n"
        "from x2radar.recording.hdf5_writer import RecordingWriter\n"
        "writer = RecordingWriter(sys.argv[1], StreamInfo(BASEBAND, 60, 'x'))\n"
        f"for frame in frames_of(noise({n})): writer.write(frame)\n"
        "os._exit(9)\n"
    )
    assert ran("-c", code, path).returncode == 9
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
    # Nor does a reader that nobody closes crash at the end.
    code = (
        "import sys; from x2radar.recording.registry import open_recording\n"
        "reader = open_recording(sys.argv[1]); print(next(reader.frames()).counter)"
    )
    done = ran("-c", code, path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "1\n", "")


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


def packed_by_a_stranger(file):
    del file[S]
    made = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    made.set_chunk((1, 64))
    made.set_filter(32_001, h5py.h5z.FLAG_OPTIONAL, (2, 2, 4, 1))
    space, kind = h5py.h5s.create_simple((40, 64)), h5py.h5t.py_create(np.dtype("f4"))
    h5py.h5d.create(file["frames"].id, b"samples", kind, space, made)


def long_text(file):
    """Ten thousand labels that share one text of a megabyte."""
    text = h5py.string_dtype()
    file["labels/t0_s"] = file["labels/t1_s"] = np.zeros(9000)
    labels = file.create_dataset("labels/label", 9000, text)
    labels[:] = "x"
    labels[0] = "y" * 4_300_000


S, HUGE = "frames/samples", {"dtype": "c8", "chunks": (60, 64), "compression": "gzip"}
GROWS = HUGE | {"chunks": (2**10, 2**14), "maxshape": (None, None)}


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
        (put(S, shape=(10, 2**10), **GROWS), "chunks of"),
        (put(S, shape=(40, 64), dtype="c8", chunks=(1, 64), scaleoffset=None), None),
        (put(S, shape=(40, 64), dtype="i4", chunks=(1, 64), scaleoffset=3), "packed by"),
        (packed_by_a_stranger, "packed by filter 32001"),
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


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data.ljust(-(-len(data) // 8) * 8, b"\0")


def mat_of(kind, n, names):
    """A MATLAB file with an array `scn` of some class, said to have n elements."""
    names = struct.pack("<HHI", 5, 4, 4) + element(1, names) if kind == 2 else b""
    head = element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack("<ii", 1, n))
    body = element(14, head + element(1, b"scn") + names)
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + body


MATS = [
    *((kind, n, b"scn\0") for kind in (1, 2, 4, 5, 6) for n in (3, (1 << 31) - 1, -1)),
    *((2, (1 << 31) - 1, names) for names in (b"", b"xyz\0", b"x\0\0\0" * (1 << 22))),
]


@pytest.mark.parametrize(("kind", "n", "names"), MATS, ids=range(len(MATS)))
def test_a_mat_file_that_says_more_than_it_holds(tmp_path, worker, kind, n, names):
    """Of 216 bytes, or none, a list of 2^31 elements was made, 85 MB a second."""
    data = mat_of(kind, n, names)
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
SIXTY = npy((), "<f8", struct.pack("<d", 60.0))
NUMBERS = dict.fromkeys(("frame_rate_hz", "carrier_hz", "bin_length_m"), SIXTY)


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({"samples": npy((40, 8), "|O", pickle.dumps(Boom()))}, "no frames"),
        ({"samples": GOOD, "device": npy((), "|O", pickle.dumps(Boom()))}, "is object"),
        ({"samples": GOOD, "counter": npy((40,), "|O", pickle.dumps(Boom()))}, "is object"),
        ({"samples": npy((1 << 40, 8))}, "cut off"),
        ({"samples": npy((-40, 8))}, "shape"),
        ({"samples": npy((3,), data=bytes(24))}, "shape"),
        ({"samples": npy((40, 8), "<U1", bytes(40 * 32))}, "no frames"),
        ({"other": GOOD}, "samples"),
        ({"samples": GOOD, "counter": npy((3,), "<u4", bytes(12))}, "counter"),
        ({"samples": npy((40, 1 << 20))}, "shape"),
        ({"samples": GOOD, "counter": bytes(1 << 28)}, "too much"),
        ({"samples": GOOD, "device": bytes(1 << 28)}, "too much"),
        ({"samples": GOOD, "t_s": npy((1 << 40,), "<f8")}, "which is not read"),
        ({"samples": b"\x93NUMPY\2\0" + b"\xff" * 4 + bytes(1 << 27)}, "array header"),
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
