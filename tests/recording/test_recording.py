"""What is written, and read, of our own format; and a disk that takes no more."""

import json
import resource
import signal

import h5py
import numpy as np
import pytest

from tests.alarm_helpers import write_recording
from tests.processes import ran
from tests.radar_helpers import BASEBAND, frames_of, noise
from tests.recording_helpers import record_scene
from x2radar.errors import RecordingError
from x2radar.frame import StreamInfo
from x2radar.recording.about import Overrides
from x2radar.recording.hdf5_reader import RecordingReader
from x2radar.recording.hdf5_writer import RecordingWriter

META = {"started_utc": "2026-01-01T00:00:00Z", "device": {"name": "x"}, "settings": {}}


def write(path, samples):
    with RecordingWriter(path, StreamInfo(BASEBAND, 60.0, "x"), **META) as writer:
        for frame in frames_of(samples):
            writer.write(frame)
    return path


def minimal(path, **changes):
    """A valid recording as another program may write it, changed; None leaves something out."""
    sets = {name: changes.pop(name) for name in ("samples", "counter", "t_s") if name in changes}
    write_recording(path, noise(10, 8).astype(np.complex128), sets=sets, **changes)
    return path


@pytest.mark.parametrize(
    ("sampled_hz", "carrier_hz", "stated_hz", "known_hz"),
    [
        *((41e9, 6.8e9, None, 2.3e9), (38.9e9, 7.3e9, None, 2.35e9), (41e9, 6.8e9, 1.7e9, 1.7e9)),
        *((41e9, 4.2e9, None, 0), (23.328e9, 7.29e9, None, 1.4e9), (16e9, 6.8e9, None, 0)),
        *((23.328e9, 8.748e9, None, 1.5e9), (23.328e9, 6.8e9, None, 0)),
    ],
)
def test_a_pulse_is_known_by_its_sampler_and_carrier(
    tmp_path, sampled_hz, carrier_hz, stated_hz, known_hz
):
    """Without it the velocities of a stream are made otherwise than those of a live module."""
    said = {"sample_rate_hz": sampled_hz, "carrier_hz": carrier_hz, "bandwidth_hz": stated_hz}
    path = minimal(tmp_path / "r.h5", **said)
    assert RecordingReader(path).stream.axis.bandwidth_hz == known_hz
    own = RecordingReader(path, Overrides(bandwidth_hz=2e9))
    assert own.stream.axis.bandwidth_hz == 2e9


def test_phase_sign_is_brought_to_falling(tmp_path):
    samples = noise(10, 8)
    reader = RecordingReader(minimal(tmp_path / "m.h5", samples=samples, phase_sign=1))
    assert np.array_equal(next(reader.frames()).samples, samples[0].conj())
    assert reader.stream.axis.phase_sign == -1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format": "other"}, "'format'"),
        ({"format": None}, "'format'"),
        *(({"format_version": other}, "format_version") for other in (2, "2", "one", 1.5, "")),
        *(({"phase_sign": sign}, "'phase_sign' is") for sign in (2, 0.5, -7)),
        ({"kind": "video"}, "no video data"),
        ({"carrier_hz": None}, "'carrier_hz' is missing"),
        ({"frame_rate_hz": 0.0}, "'frame_rate_hz' is 0"),
        ({"frame_rate_hz": "fast"}, "not a number"),
        ({"bin_length_m": np.nan}, "not a number"),
        ({"samples": None}, "'/frames/samples' is missing"),
        ({"counter": None}, "'/frames/counter' is missing"),
        ({"samples": np.zeros(10, np.complex64)}, "shape"),
        ({"samples": np.zeros((10, 8), np.float32)}, "no baseband data"),
        ({"kind": "rf"}, "no rf data"),
        ({"t_s": np.zeros((10, 2))}, "/frames/t_s"),
        ({"samples": np.zeros((0, 8), np.complex64)}, "no frames"),
        ({"samples": np.zeros((8, 10), np.complex64)}, "a column a frame"),
    ],
)
def test_faults_are_named(tmp_path, changes, words):
    with pytest.raises(RecordingError, match=words) as caught:
        RecordingReader(minimal(tmp_path / "m.h5", **changes))
    assert "\n" not in str(caught.value)


def test_attributes_are_those_of_the_contract(tmp_path):
    with h5py.File(write(tmp_path / "r.h5", noise(3))) as file:
        assert file.attrs["format"] == "x2radar-recording"
        assert json.loads(file.attrs["device"]) == {"name": "x"}
        assert file["frames/counter"].dtype == np.uint32
        assert file["frames/t_s"].dtype == np.float64
        assert file["frames/samples"].chunks == (60, 64)
        assert file["frames/samples"].compression == "gzip"
        assert file["frames/samples"].shuffle
    # A frame of another length is refused.
    writer = RecordingWriter(tmp_path / "w.h5", StreamInfo(BASEBAND, 60, "x"), **META)
    with pytest.raises(RecordingError, match="32 bins"):
        writer.write(next(frames_of(noise(1, 32))))
    writer.close()
    writer.close()


_CODE = """
import contextlib, importlib, io, json, sys
for argv in json.loads(sys.argv[1]):
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        rc = importlib.import_module(argv[0]).main(argv[1:])
    print(json.dumps([rc, said.getvalue()]))
"""


def limited(n_bytes):
    """A limit on a file's size stands for the disk's end: the write itself fails."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, n_bytes))


@pytest.mark.integration
def test_what_cannot_be_written_is_said_and_leaves_nothing_behind(tmp_path):
    source, out = tmp_path / "a.h5", tmp_path / "out"
    record_scene(source, "human", n=400)
    out.mkdir()
    converted = [out / f"x.{name}" for name in ("h5", "npz", "mat", "parquet", "sigmf-meta")]
    replaced = [out / "plot.png", out / "why.svg"]
    for path in replaced:
        path.write_text("old")
    calls = [["x2radar.cli", "convert", source, path] for path in converted]
    calls += [["x2radar.cli", "plot", source, "--out", replaced[0]]]
    calls += [["radard.cli", "why", source, "--at", "4", "--out", replaced[1]]]
    calls += [["radard.cli", "calibrate", "--port", "sim:empty", "--speed", "max"]]
    calls[-1] += ["--duration", "25", "--out", out / "room.json"]
    limit = {"preexec_fn": lambda: limited(900), "cwd": tmp_path}
    done = ran("-c", _CODE, json.dumps(calls, default=str), **limit)
    assert done.returncode == 0, done.stderr
    told = [json.loads(line) for line in done.stdout.splitlines()]
    for call, (rc, said) in zip(calls, told, strict=True):
        assert rc == 1, (call, said)
        # A library of its own writes Parquet, and wraps what it is told.
        assert f"{call[-1]}: cannot write: " in said, said
        assert said.endswith("File too large\n"), said
        assert said.count("\n") == 1, said
    assert {path.name: path.read_text() for path in out.iterdir()} == {
        path.name: "old" for path in replaced
    }


@pytest.mark.integration
def test_a_recording_that_fills_the_disk_is_readable(tmp_path):
    path = tmp_path / "w.h5"
    argv = ("record", path, "--port", "sim:dog", "--speed", "max", "--duration", "60")
    done = ran("-m", "x2radar", *argv, preexec_fn=lambda: limited(2_000_000), timeout=60)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "cannot write" in done.stderr
    with RecordingReader(path) as reader:
        assert len(list(reader.frames())) >= 60
