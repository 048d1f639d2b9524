import json
import time
from itertools import islice

import numpy as np
import pytest

from tests.device_helpers import wire
from tests.recording_helpers import N, assert_same_frames, captured, content, refused, run
from x2radar.commands.convert import convert
from x2radar.errors import RecordingError
from x2radar.modules.x2 import RadarSettings
from x2radar.recording import capture as wire_capture
from x2radar.recording.capture import FROM_MODULE, TO_MODULE, Capture, CaptureWriter
from x2radar.recording.registry import open_recording
from x2radar.wire.messages import Ack, Data, Ping, Reset


def written(path, about, *records):
    """A capture of records by hand: kinds, each with its bytes."""
    writer = CaptureWriter(path, about)
    for record in records:
        writer.add(*record)
    writer.close()
    return path


def test_a_port_that_was_opened_twice(tmp_path):
    path = tmp_path / "w.x2cap"
    frames = captured(path, is_usb=True)
    kinds = [chunk.kind for chunk in Capture(path).chunks()]
    assert (kinds.count(wire_capture.OPENED), kinds.count(wire_capture.CLOSED)) == (2, 2)
    with open_recording(path) as reader:
        assert_same_frames(frames, islice(reader.frames(), N))


def test_a_cut_or_damaged_capture_is_good_as_far_as_it_goes(tmp_path):
    path = tmp_path / "w.x2cap"
    captured(path, n=5)
    whole, chunks = path.read_bytes(), list(Capture(path).chunks())
    flipped = bytearray(whole)
    flipped[-2000] ^= 1
    for data in (*(whole[:at] for at in range(len(whole) - 4000, len(whole), 37)), flipped):
        path.write_bytes(data)
        capture = Capture(path)
        got = list(capture.chunks())
        assert got == chunks[: len(got)]
        assert capture.warning is None or "cut off or damaged" in capture.warning
    assert 0 < len(got) < len(chunks)


@pytest.mark.parametrize(
    "content_", [b"", b"X2RA", b"hello, world", b"X2RADARC\x02\0\0\0\0\0\0\0"]
)
def test_no_capture(tmp_path, content_):
    (tmp_path / "x").write_bytes(content_)
    with pytest.raises(RecordingError, match="capture"):
        Capture(tmp_path / "x")
    with pytest.raises(RecordingError, match="cannot be read"):
        Capture(tmp_path / "gone")


def test_writer_overwrites_nothing_and_leaves_nothing_empty(tmp_path):
    (tmp_path / "x").write_bytes(b"mine")
    with pytest.raises(RecordingError, match="exists already"):
        CaptureWriter(tmp_path / "x", {})
    with pytest.raises(RecordingError, match="cannot make"):
        CaptureWriter(tmp_path / "no" / "x", {})
    CaptureWriter(tmp_path / "y", {}).close()
    assert not (tmp_path / "y").exists()


@pytest.mark.parametrize("output", ["rf", "iq", "ap"])
def test_a_capture_is_a_recording_too(tmp_path, output):
    path = tmp_path / "w.x2cap"
    frames = captured(path, RadarSettings(output=output), n=200)
    with open_recording(path) as reader:
        got = list(reader.frames())
        assert reader.n_frames >= 200  # the module sent on while the driver closed
        assert_same_frames(frames, got[:200])
        assert next(f.index for f in reader.frames(2.0)) == 120
        assert reader.warning is None
        assert np.array_equal(content(reader)[0][:200], [f.samples for f in frames])
    done = convert(path, tmp_path / "w.h5")
    with open_recording(tmp_path / "w.h5") as reader:
        assert_same_frames(frames, islice(reader.frames(), 200))
        assert reader.n_frames == done.n_frames


def test_a_capture_whose_settings_nobody_knows_says_so_and_one_has_no_frames(tmp_path):
    sent = wire(*(Data(0, k, np.zeros(4, np.float32)) for k in range(9)))
    about = {"settings": {"frame_rate_hz": "sixty"}}
    with open_recording(written(tmp_path / "w", about, (FROM_MODULE, sent))) as reader:
        assert "settings that are not known" in reader.warning
    about = {"settings": {"output": "?", "junk": 1}}
    refused(written(tmp_path / "none", about, (FROM_MODULE, wire(Ack()))), "no frames")


def test_decode_of_a_capture(capsys, tmp_path):
    ping = wire(Ping())
    path = written(
        tmp_path / "w",
        {},
        (wire_capture.OPENED, b"\0"),
        (TO_MODULE, ping[:3]),
        (FROM_MODULE, wire(Ack()) + b"\x01"),
        (TO_MODULE, ping[3:] + wire(Reset())),
        (FROM_MODULE, wire(Ack())[:-1]),
        (wire_capture.CLOSED,),
    )
    with path.open("ab") as file:
        file.write(b"<12")
    code, out, err = run(capsys, "decode", path)
    assert (code, err) == (0, "")
    items = [json.loads(line) for line in out.splitlines()]
    assert [item.get("port") for item in items if "port" in item] == ["opened", "closed"]
    messages = [(i["direction"], i["message"]) for i in items if "message" in i]
    assert messages == [("from_module", "Ack"), ("to_module", "Ping"), ("to_module", "Reset")]
    faults = [item["fault"] for item in items if "fault" in item]
    assert "junk between packets" in faults
    assert "incomplete packet at the end" in faults
    assert "cut off" in faults[-1]
    times = [item["t_s"] for item in items]
    assert times == sorted(times)
    code, out, err = run(capsys, "decode", path, "--summary")
    assert (code, err) == (0, "")
    lines = [" ".join(line.split()) for line in out.splitlines()]
    told = ["packets 3", "1 Ack, from module", "1 Ping, to module", "1 Reset, to module"]
    assert lines[:4] == told
    assert "faults 3" in lines


def test_a_summary_tells_rate_and_gaps(capsys, tmp_path):
    path = tmp_path / "w"
    writer = CaptureWriter(path, {})
    for counter in (1, 2, 5, 6, 6):
        writer.add(FROM_MODULE, wire(Data(0, counter, np.zeros(4, np.float32))))
        time.sleep(0.02)
    writer.close()
    code, out, _ = run(capsys, "decode", path, "--summary")
    assert code == 0
    assert "5; 2 lost in 1 gaps, longest 2; 0 restarts, 1 repeats" in out
    assert 5 < float(out.partition("rate")[2].split()[0]) < 50.1
