"""Readers of foreign files, made by hand here."""

import struct

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from tests.radar_helpers import noise
from tests.recording_helpers import content, make, refused
from x2radar.frame import count_by_stamps
from x2radar.recording.about import Overrides
from x2radar.recording.formats.xethru import META, X4_BIN_LENGTH_M, Reader
from x2radar.recording.formats.xethru import write as write_xethru
from x2radar.recording.registry import open_recording

PERIOD_S = 0.0327996


@pytest.mark.parametrize("lost", [[], [5], [5, 6, 7, 300], list(range(100, 150))])
def test_counters_from_rounded_stamps(lost):
    index = np.delete(np.arange(1000), lost)
    counter, period_s = count_by_stamps(np.rint(index * PERIOD_S * 1e3) / 1e3)
    assert (counter == index + 1).all()
    assert period_s == pytest.approx(PERIOD_S, rel=1e-5)


def test_late_stamps_are_no_losses():
    index = np.arange(400)
    late = np.zeros(400)
    for k in range(0, 400, 20):  # as the X2M200 sends them over USB
        late[k : k + 4] = [0.19, 0.145, 0.1, 0.055]
    late[0] = 0
    counter, period_s = count_by_stamps(index * 0.05 + late)
    assert (counter == index + 1).all()
    assert period_s == pytest.approx(0.05, rel=0.01)


@pytest.mark.parametrize("stamps", [[0, 0, 0], [3, 2, 1], [0, np.nan, 1]])
def test_stamps_without_use(stamps):
    counter, period_s = count_by_stamps(np.array(stamps, float))
    assert counter.tolist() == [1, 2, 3]
    assert np.isnan(period_s)


def mat(path, n=40, lost=(), **fields):
    index = np.delete(np.arange(n), list(lost))
    rows = np.random.default_rng(0).integers(-400_000, 400_000, (len(index), 30), np.int32)
    struct_of = {
        "T": [np.int32(31_583_487 + round(k * PERIOD_S * 1e3)) for k in index],
        "scn": list(rows),
        **fields,
    }
    scn = np.empty((1, len(index)), [(name, object) for name in struct_of])
    for name, values in struct_of.items():
        for k in range(len(index)):
            scn[name][0, k] = values[k]
    savemat(path, {"scn": scn, "cfg": np.zeros(1)})
    return path, rows, index


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        (b"\x05\0\x04\0", b"\x80\0\x04\0"),  # values of a type that there is not
        (b"\x01\0\0\0\0\0\0\0", b"\x01\0\0\0\x07\0\0\0"),  # a name in place of the values
        (b"\x06\0\0\0\x08\0\0\0", b"\x06\0\0\0\x10\0\0\0"),  # flags of another length
    ],
)
def test_an_array_that_holds_what_it_cannot_is_refused(tmp_path, good, bad):
    """scipy, which reads on at any place and of any type, crashed the process."""
    path, *_ = mat(tmp_path / "w.mat")
    whole = path.read_bytes()
    at = whole.index(good, whole.index(b"scn\0"))
    path.write_bytes(whole[:at] + bad + whole[at + len(bad) :])
    refused(path, r"damaged|cut off")


def test_p4xx(tmp_path):
    path, _, _ = mat(tmp_path / "s.mat", Tstrt=[np.uint16(20_000)] * 40)
    with open_recording(path) as reader:
        assert reader.stream.axis.range_offset_m == pytest.approx(299_792_458 * 20e-9 / 2)
    path, rows, index = mat(tmp_path / "w.mat", lost=[7, 8, 20])
    with open_recording(path) as reader:
        samples, counter, _ = content(reader)
        assert samples.dtype == np.float32
        assert np.array_equal(samples, rows)
        assert (counter == index + 1).all()
        assert [f.lost for f in reader.frames() if f.lost] == [2, 1]
        stream = reader.stream
    assert stream.frame_rate_hz == pytest.approx(1 / PERIOD_S, rel=2e-3)
    axis = stream.axis
    assert (axis.kind, axis.carrier_hz) == ("rf", 4.0e9)
    assert axis.bandwidth_hz == pytest.approx(1.7e9)
    assert axis.bin_length_m == pytest.approx(9.149e-3, abs=1e-6)
    assert axis.range_offset_m == pytest.approx(299_792_458 * 17.499e-9 / 2)
    # One scan needs a rate.
    path, _, _ = mat(tmp_path / "w.mat", n=1)
    refused(path, "--frame-rate")
    assert open_recording(path, overrides=Overrides(frame_rate_hz=30)).n_frames == 1


def test_no_p4xx(tmp_path):
    savemat(tmp_path / "a.mat", {"x": np.zeros(3)})
    savemat(tmp_path / "b.mat", {"scn": np.zeros(3)})
    mat(tmp_path / "c.mat", scn=[np.zeros(k % 2 + 1) for k in range(40)])
    whole = mat(tmp_path / "d.mat")[0].read_bytes()
    (tmp_path / "d.mat").write_bytes(whole[: len(whole) // 2])
    for name in "abcd":
        refused(tmp_path / f"{name}.mat", rf"{name}\.mat")
    with h5py.File(tmp_path / "e.mat", "w", userblock_size=512) as file:
        file["scn"] = [1]
    data = bytearray((tmp_path / "e.mat").read_bytes())
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    data[: len(head)] = head
    (tmp_path / "e.mat").write_bytes(data)
    refused(tmp_path / "e.mat", r"7\.3 files are not read")


def logger(path, *, n=20, rate=1.08e-19, fps=200, times=None, radar=2, pg=5, n_range=256):
    times = np.arange(n) / 200.3 if times is None else np.asarray(times, float)
    counter = np.random.default_rng(2).integers(0, 17_665, (n, n_range), np.uint32)
    head = struct.pack("<I6i", 0xFEFE00A2, 8, 16, 3000, 4104, 8, radar)
    head += struct.pack("<fiff", rate, pg, 0.25, 3.867e-9)
    head += struct.pack("<4i", n_range, n, 1, fps)
    path.write_bytes(head + times.tobytes() + counter.tobytes() + struct.pack("<f", 199.9))
    return path, counter


def test_framelogger(tmp_path):
    path, counter = logger(tmp_path / "loopback.dat")
    with open_recording(path) as reader:  # by content, whatever its name
        samples, _, _ = content(reader)
        stream = reader.stream
        assert "39e9 is assumed" in reader.warning
    want = (counter / (16 * 8) * 8 + 3000) * 100 / 8192
    assert np.abs(samples - want).max() < 5e-6
    step = np.diff(np.unique(samples.astype(float))).min()
    assert step == pytest.approx(100 / 8192 * 8 / 128, rel=0.05)  # seen in real files
    assert stream.frame_rate_hz == pytest.approx(200.3)
    assert stream.axis.sample_rate_hz == 39e9
    assert stream.axis.bin_length_m == pytest.approx(3.8435e-3, abs=1e-6)
    assert stream.axis.range_offset_m == 0.25
    assert (stream.axis.carrier_hz, stream.axis.bandwidth_hz) == (6.8e9, 2.3e9)
    with open_recording(path, overrides=Overrides(sample_rate_hz=41e9)) as reader:
        assert reader.stream.axis.bin_length_m == pytest.approx(299_792_458 / 82e9)
        assert reader.warning is None


def test_no_framelogger(tmp_path):
    path, _ = logger(tmp_path / "x1", radar=10)
    refused(path, "only X2 files")
    path, _ = logger(tmp_path / "none", pg=99)
    refused(path, "--carrier")
    path, _ = logger(tmp_path / "cut")
    for share in (0.01, 0.5, 0.99):
        data = path.read_bytes()
        (tmp_path / "c").write_bytes(data[: int(share * len(data))])
        refused(tmp_path / "c", r"c: (cut off|not a|no rec)", kind="framelogger")


def test_numpy_by_hand(tmp_path):
    samples = noise(10, 8).astype(np.complex128)
    path = tmp_path / "a.npz"
    np.savez_compressed(path, samples=samples, frame_rate_hz=50, bin_length_m=0.03)
    refused(path, r"convert it with --carrier$")
    with open_recording(path, overrides=Overrides(carrier_hz=7e9)) as reader:
        assert np.array_equal(content(reader)[0], samples.astype(np.complex64))
        assert [f.index for f in reader.frames(0.1)] == [5, 6, 7, 8, 9]


def test_a_written_xethru_recording_without_our_header(tmp_path):
    source, samples = make(tmp_path / "in.h5")
    with open_recording(source) as reader:
        write_xethru(tmp_path / "x", reader)
        axis = reader.stream.axis
    meta = tmp_path / "x" / META
    meta.write_bytes(meta.read_bytes().replace(b'"x2radar"', b'"another"', 1))
    with Reader(tmp_path / "x") as reader:
        assert np.array_equal(content(reader)[0], samples)
        assert reader.stream.frame_rate_hz == pytest.approx(60.25, rel=1e-3)
        assert reader.stream.axis.bin_length_m == pytest.approx(axis.bin_length_m, rel=1e-7)
        assert reader.stream.axis.bandwidth_hz == axis.bandwidth_hz
        assert reader.started_utc == "2026-03-01T12:30:00.250Z"


BITS = {"datafloat": 0x400, "baseband_iq": 0x2, "baseband_ap": 0x1}


def record(kind, counter, z):
    if kind == "datafloat":
        head = struct.pack("<III", 0, counter, 2 * z.size)
    else:
        head = struct.pack("<IIffff", counter, z.size, 0.0514, 2.916e9, 7.29e9, 0.3)
    pair = (np.abs(z), np.angle(z)) if kind == "baseband_ap" else (z.real, z.imag)
    return head + b"".join(np.asarray(a, "<f4").tobytes() for a in pair)


def meta(kind, times_ms):
    session = b"session\0"
    head = struct.pack("<IIQBIQQIqII", 0xA0B1C2D3, 13, 1_736_000_000_000, 1, 0, 0, 0, 0, -1, 0, 0)
    head = head.ljust(0x39, b"\0") + b"\xcd" * 28
    body = struct.pack("<I", len(session)) + session + struct.pack("<I", 0)
    for ms in times_ms:
        body += struct.pack("<BIQQI", 1, BITS[kind], 0, 0, 0)[:29].ljust(29, b"\0")
        body += struct.pack("<I", ms)
    body += struct.pack("<BI", 3, 0)
    return head + body


def folder(path, kind, z, *, split=None, rate_hz=17.0, counters=None):
    path.mkdir()
    counters = list(range(1, len(z) + 1)) if counters is None else counters
    records = [record(kind, c, row) for c, row in zip(counters, z, strict=True)]
    cut = len(records) if split is None else split
    (path / f"xethru_{kind}_20260101_000000.dat").write_bytes(b"".join(records[:cut]))
    if split is not None:
        (path / f"xethru_{kind}_20260101_000100.dat").write_bytes(b"".join(records[cut:]))
    times = [round(1000 * (c - counters[0]) / rate_hz) for c in counters]
    (path / "xethru_recording_meta.dat").write_bytes(meta(kind, times))
    return path


@pytest.mark.parametrize("kind", list(BITS))
@pytest.mark.parametrize("split", [None, 30])
def test_every_kind_is_read(tmp_path, kind, split):
    z = noise(60, 20)
    reader = open_recording(folder(tmp_path / "r", kind, z, split=split))
    assert reader.n_frames == 60
    assert reader.stream.frame_rate_hz == pytest.approx(17, abs=0.01)
    got = list(reader.frames())
    assert np.allclose([f.samples for f in got], z, atol=1e-6)
    assert [f.index for f in got] == list(range(60))
    assert not got[0].samples.flags.writeable
    axis = reader.stream.axis
    assert axis.kind == "baseband"
    assert axis.carrier_hz == pytest.approx(7.29e9)
    if kind == "datafloat":
        assert axis.bin_length_m == X4_BIN_LENGTH_M
        assert "assumed" in reader.warning
    else:
        assert axis.range_offset_m == pytest.approx(0.3)
        assert reader.warning is None
    assert reader.started_utc == "2025-01-04T14:13:20.000Z"


def test_one_file_and_a_rate_of_ones_own(tmp_path):
    path = folder(tmp_path / "r", "datafloat", noise(5, 4))
    file = next(path.glob("*datafloat*"))
    assert Reader(file).n_frames == 5
    (path / "xethru_recording_meta.dat").unlink()
    refused(file, "frame rate is unknown", kind="xethru")
    assert Reader(file, Overrides(frame_rate_hz=20)).stream.frame_rate_hz == 20


def test_a_cut_record_is_dropped_and_said(tmp_path):
    path = folder(tmp_path / "r", "baseband_iq", noise(5, 4))
    file = next(path.glob("*baseband*"))
    file.write_bytes(file.read_bytes()[:-3])
    reader = Reader(path)
    assert reader.n_frames == 4
    assert "cut off" in reader.warning


FOREIGN = [
    (b"", "no whole record"),
    (b"abc", "no whole record"),
    (b"\xff" * 100, "no baseband_iq records"),
    (b"".join(struct.pack("<II48x", k, 4) for k in (1, 2)), "'bin_length_m'"),
    (record("baseband_iq", 1, noise(1, 4)[0]) + b"\1" * 56, "different length"),
]


@pytest.mark.parametrize(
    ("kind", "name", "content", "words"),
    [
        *(("baseband_iq", "*baseband*", *row) for row in FOREIGN),
        *(("datafloat", META, data, ".") for data in (b"", b"\0" * 200, meta("datafloat", []))),
    ],
)
def test_foreign_content(tmp_path, kind, name, content, words):
    path = folder(tmp_path / "r", kind, noise(5, 4))
    next(path.glob(name)).write_bytes(content)
    refused(path, words, kind="xethru")


def test_empty_folder_foreign_file_and_nothing(tmp_path):
    (tmp_path / "e").mkdir()
    (tmp_path / "x.dat").write_bytes(b"1")
    for name in ("e", "gone", "x.dat"):
        refused(tmp_path / name, "no xethru_datafloat", kind="xethru")
