import struct
from pathlib import Path

import numpy as np
import pytest

from tests.radar_helpers import noise
from x2radar.errors import RecordingError
from x2radar.recording.about import Overrides
from x2radar.recording.formats.xethru import X4_BIN_LENGTH_M, XethruReader
from x2radar.recording.registry import open_recording

BITS = {"datafloat": 0x400, "baseband_iq": 0x2, "baseband_ap": 0x1}
REAL = Path(__file__).parents[3] / "shared" / "data" / "x4m03_recording"


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
    assert XethruReader(file).n_frames == 5
    (path / "xethru_recording_meta.dat").unlink()
    with pytest.raises(RecordingError, match="frame rate is unknown"):
        XethruReader(file)
    assert XethruReader(file, Overrides(frame_rate_hz=20)).stream.frame_rate_hz == 20


def test_a_cut_record_is_dropped_and_said(tmp_path):
    path = folder(tmp_path / "r", "baseband_iq", noise(5, 4))
    file = next(path.glob("*baseband*"))
    file.write_bytes(file.read_bytes()[:-3])
    reader = XethruReader(path)
    assert reader.n_frames == 4
    assert "cut off" in reader.warning


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no whole record"),
        (b"abc", "no whole record"),
        (b"\xff" * 100, "no baseband_iq records"),
        (struct.pack("<IIffff", 1, 4, -1, 0, 0, 0) + bytes(32), "bin length"),
        (record("baseband_iq", 1, noise(1, 4)[0]) + b"\1" * 56, "different length"),
    ],
)
def test_foreign_content(tmp_path, content, words):
    path = folder(tmp_path / "r", "baseband_iq", noise(2, 4))
    next(path.glob("*baseband*")).write_bytes(content)
    with pytest.raises(RecordingError, match=words):
        XethruReader(path)


@pytest.mark.parametrize("content", [b"", b"\0" * 200, meta("datafloat", [])])
def test_a_meta_file_that_helps_nothing(tmp_path, content):
    path = folder(tmp_path / "r", "datafloat", noise(5, 4))
    (path / "xethru_recording_meta.dat").write_bytes(content)
    with pytest.raises(RecordingError):
        XethruReader(path)


def test_empty_folder_foreign_file_and_nothing(tmp_path):
    (tmp_path / "e").mkdir()
    for name, words in (("e", "no xethru"), ("gone", "no such")):
        with pytest.raises(RecordingError, match=words):
            XethruReader(tmp_path / name)
    (tmp_path / "x.dat").write_bytes(b"1")
    with pytest.raises(RecordingError, match="not one of"):
        open_recording(tmp_path / "x.dat")


@pytest.mark.skipif(not REAL.is_dir(), reason="the real X4M03 recording is not on this machine")
def test_a_real_recording():
    reader = open_recording(REAL)
    frames = list(reader.frames())
    assert len(frames) == 1518
    assert frames[0].samples.shape == (91,)
    assert reader.stream.frame_rate_hz == pytest.approx(17.06, abs=0.02)
    assert sum(f.lost for f in frames) == 0
