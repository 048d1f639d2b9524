"""Our own format, whole and in parts: written, read, ended, and a disk that takes no more."""

import json
import resource
import signal
import threading

import h5py
import numpy as np
import pytest

from tests.alarm_helpers import write_recording
from tests.processes import ran
from tests.radar_helpers import BASEBAND, frames_of, noise
from tests.recording_helpers import assert_same_frames, content, record_scene, refused, run
from x2radar.commands import record as command
from x2radar.commands.record import record, stop_signals
from x2radar.errors import ReadTimeout, RecordingError
from x2radar.frame import Frame, StreamInfo
from x2radar.recording.about import Overrides
from x2radar.recording.hdf5_reader import RecordingReader
from x2radar.recording.hdf5_writer import RecordingWriter, write_labels
from x2radar.recording.parts import PartsReader, RotatingWriter, existing_parts
from x2radar.recording.registry import open_recording

STREAM = StreamInfo(BASEBAND, 60.0, "x")
META = {"started_utc": "2026-01-01T00:00:00.000Z", "device": {"name": "x"}, "settings": {}}


def write(path, samples):
    with RecordingWriter(path, STREAM, **META) as writer:
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
def test_sampler_and_carrier_tell_the_pulse(tmp_path, sampled_hz, carrier_hz, stated_hz, known_hz):
    """Without it the velocities of a stream are made otherwise than those of a live module."""
    said = {"sample_rate_hz": sampled_hz, "carrier_hz": carrier_hz, "bandwidth_hz": stated_hz}
    path = minimal(tmp_path / "r.h5", **said)
    assert RecordingReader(path).stream.axis.bandwidth_hz == known_hz
    assert RecordingReader(path, Overrides(bandwidth_hz=2e9)).stream.axis.bandwidth_hz == 2e9


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
    refused(minimal(tmp_path / "m.h5", **changes), words)


def test_half_a_frame_number_is_refused(tmp_path):
    """Half a number was cut off."""
    path = minimal(tmp_path / "m.h5", counter=np.arange(10) + 0.5)
    with pytest.raises(RecordingError, match="no numbers of frames"):
        list(RecordingReader(path).frames())


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
    writer = RecordingWriter(tmp_path / "w.h5", STREAM, **META)
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
    assert {p.name: p.read_text() for p in out.iterdir()} == {p.name: "old" for p in replaced}


@pytest.mark.integration
def test_a_recording_that_fills_the_disk_is_readable(tmp_path):
    path = tmp_path / "w.h5"
    argv = ("record", path, "--port", "sim:dog", "--speed", "max", "--duration", "60")
    done = ran("-m", "x2radar", *argv, preexec_fn=lambda: limited(2_000_000), timeout=60)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "cannot write" in done.stderr
    with RecordingReader(path) as reader:
        assert len(list(reader.frames())) >= 60


def lossy(n=1000):
    """Frames with a gap at the end of a part, a gap within one, and a restart."""
    samples = noise(n)
    lost_before = {120: 3, 400: 1, 407: 20}
    index = counter = -1
    for k, row in enumerate(samples):
        lost = lost_before.get(k, 0)
        index += 1 + lost
        counter = 50_000_000 if k == 700 else counter + 1 + lost
        yield Frame(row, counter, index, lost, k == 700, BASEBAND)


@pytest.mark.parametrize("how", [{"rotate_s": 2.0}, {"rotate_bytes": 120e3}, {"rotate_s": 0.05}])
def test_parts_read_as_one(tmp_path, how):
    frames = list(lossy(100 if how == {"rotate_s": 0.05} else 1000))
    path = tmp_path / "w.h5"
    with RotatingWriter(path, STREAM, **META, **how) as writer:
        for frame in frames:
            writer.write(frame)
        assert writer.n_bytes > 0
    parts = existing_parts(path)
    assert parts == writer.paths == [tmp_path / f"w_{k:03d}.h5" for k in range(len(parts))]
    assert len(parts) >= 5
    if "rotate_bytes" in how:
        assert all(part.stat().st_size < 120e3 for part in parts)
        assert parts[0].stat().st_size > 60e3
    for source in (tmp_path, path, parts, [str(p) for p in reversed(parts)]):
        with open_recording(source) as reader:
            assert_same_frames(list(reader.frames()), frames)
            assert np.allclose(content(reader)[2], [f.index / 60 for f in frames], atol=1e-12)
            late = next(reader.frames(1.0), None)
            assert late is not None
            assert late.index == next(f.index for f in frames if f.index >= 60)
            assert reader.warning is None
            assert reader.started_utc == META["started_utc"]


def parts_of(tmp_path, name="w", n=300):
    with RotatingWriter(tmp_path / name, STREAM, **META, rotate_s=2) as writer:
        for frame in frames_of(noise(n)):
            writer.write(frame)
    return writer.paths


def test_every_part_is_a_recording_of_its_own_with_labels_of_its_own(tmp_path):
    paths = parts_of(tmp_path)
    assert [p.name for p in paths] == ["w_000.h5", "w_001.h5", "w_002.h5"]
    with open_recording(paths[1]) as reader:
        assert reader.n_frames == 120
        assert content(reader)[2][0] == 0
        assert next(reader.frames()).index == 0
        assert reader.started_utc == "2026-01-01T00:00:02.000Z"
    with h5py.File(paths[2]) as file:
        assert (file.attrs["part"], file.attrs["part_start_s"]) == (2, 4.0)
    write_labels(paths[1], [(0.5, 1.0, "dog")])
    with open_recording(tmp_path) as reader:
        assert reader.labels == [(2.5, 3.0, "dog")]


def test_missing_damaged_and_foreign_parts(tmp_path):
    paths = parts_of(tmp_path)
    paths[2].write_bytes(b"killed before it began")
    with open_recording(tmp_path) as reader:
        assert reader.n_frames == 240
        assert "left out: " in reader.warning
    paths[2].unlink()
    paths[0].unlink()
    parts_of(tmp_path, "again", 130)
    (tmp_path / "again_001.h5").unlink()
    refused(tmp_path, "different recordings")
    (tmp_path / "again_000.h5").unlink()
    with open_recording(tmp_path) as reader:
        assert "parts are missing" in reader.warning
    paths[1].write_bytes(b"")
    refused(tmp_path, "not an HDF5 file")
    refused([], "no parts")
    refused(tmp_path / "other.h5", "no such recording")


def test_parts_of_other_programs_follow_their_names(tmp_path):
    for k in range(3):
        with RecordingWriter(tmp_path / f"{k}.h5", STREAM, **META) as writer:
            for frame in frames_of(noise(60, seed=k)):
                counter = frame.counter + 60 * k
                writer.write(Frame(frame.samples, counter, frame.index, 0, False, BASEBAND))
    reader = PartsReader(sorted(tmp_path.glob("*.h5")))
    assert [f.index for f in reader.frames()] == list(range(180))
    assert np.allclose(content(reader)[2], np.arange(180) / 60)
    assert [f.index for f in reader.frames(2.5)] == list(range(150, 180))


def test_closed_is_closed_and_a_name_may_be_taken_meanwhile(tmp_path):
    writer = RotatingWriter(tmp_path / "w.h5", STREAM, **META)
    writer.close()
    writer.close()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(RecordingError, match="closed"):
        writer.write(next(frames_of(noise(1))))
    writer = RecordingWriter(tmp_path / "w.h5", STREAM, **META)
    (tmp_path / "w.h5").write_bytes(b"mine")
    with pytest.raises(RecordingError, match="exists already"):
        writer.write(next(frames_of(noise(1))))
    writer.close()
    assert [p.name for p in tmp_path.iterdir()] == ["w.h5"]
    assert (tmp_path / "w.h5").read_bytes() == b"mine"


class Slow:
    """A writer that does something at one of its frames."""

    n_bytes = 0

    def __init__(self, at=5, do=lambda: None):
        self.n, self.at, self.do = 0, at, do

    def write(self, _frame):
        self.n += 1
        if self.n == self.at:
            self.do()


LOOP = {"max_frames": float("inf"), "check_every": 2}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_within_a_write_ends_after_it(number):
    writer = Slow(do=lambda: signal.raise_signal(number))
    before = signal.getsignal(number)
    with stop_signals() as stops:
        tally = record(frames_of(noise(50)), writer, stops=stops, **LOOP)
    assert (tally.n_frames, tally.is_full) == (5, False)
    assert signal.getsignal(number) is before


def test_a_second_signal_interrupts():
    with stop_signals() as stops:
        signal.raise_signal(signal.SIGINT)
        assert stops == [signal.SIGINT]
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    seen = []

    def elsewhere():
        with stop_signals() as stops:
            seen.append(list(stops))

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [[]]


def test_a_stall_is_an_error_unless_told_to_stop():
    def stalls():
        yield from frames_of(noise(3))
        raise ReadTimeout("no frame")

    with pytest.raises(ReadTimeout):
        record(stalls(), Slow(), stops=[], **LOOP)
    stalled = stalls()
    next(stalled), next(stalled), next(stalled)
    assert record(stalled, Slow(), stops=[signal.SIGINT], **LOOP).n_frames == 0


def test_record_in_parts_with_a_capture(capsys, tmp_path):
    path, wire = tmp_path / "w.h5", tmp_path / "w.x2cap"
    argv = ["record", path, "--port", "sim:dog?seed=3", "--speed", "max", "--duration", "3"]
    code, out, err = run(capsys, *argv, "--rotate-time", "1", "--capture-wire", wire, "--fsync")
    assert (code, out) == (0, "")
    assert err == f"{path}: 180 frames, 3.0 s, 3 parts\n"
    with open_recording(path) as parts, open_recording(wire) as capture:
        assert parts.settings["frame_rate_hz"] == 60
        assert parts.stream.axis == capture.stream.axis
        assert np.array_equal(content(parts)[0], content(capture)[0][:180])
    code, out, _ = run(capsys, "info", tmp_path / "w.h5", "--json")
    facts = json.loads(out)
    assert (facts["n_frames"], len(facts["parts"]), facts["lost"]) == (180, 3, 0)
    assert facts["compression"] == "shuffle+gzip"
    code, _, err = run(capsys, *argv, "--rotate-size", "1")
    assert (code, "w_000.h5: exists already" in err) == (66, True)


def test_a_simulated_module_says_who_was_there_and_a_user_may(capsys, tmp_path):
    scene = tmp_path / "s.yaml"
    both = "  - {actors: [{body: dog}, {body: human}], duration_s: 5}\n"
    scene.write_text(f"steps:\n  - {{body: cat, duration_s: 1}}\n  - {{duration_s: 0.5}}\n{both}")
    argv = ["--port", f"sim:{scene}", "--speed", "max", "--duration", "3"]
    assert run(capsys, "record", tmp_path / "w.h5", *argv, "--rotate-time", "2")[0] == 0
    with open_recording(tmp_path / "w.h5") as reader:
        t0_s, t1_s, who = zip(*reader.labels, strict=True)
    assert who == ("pet", "human", "human")
    assert (t0_s, t1_s) == (pytest.approx((0, 1.5, 2)), pytest.approx((1, 2, 3)))
    assert run(capsys, "record", tmp_path / "mine.h5", *argv, "--label", "tom")[0] == 0
    with open_recording(tmp_path / "mine.h5") as reader:
        assert reader.labels == [(0.0, 3.0, "tom")]


def test_record_stops_before_the_disk_is_full(capsys, tmp_path, monkeypatch):
    free = iter([10e9, 10e9, 10e9])
    monkeypatch.setattr(command, "free_bytes", lambda *_paths: next(free, 1e6))
    path = tmp_path / "w.h5"
    code, out, err = run(capsys, "record", path, "--port", "sim:dog", "--speed", "max")
    assert (code, out) == (1, "")
    assert f"{path}: 180 frames, 3.0 s; stopped, less than 200 MB are free" in err
    assert err.count("\n") == 1
    with open_recording(path) as reader:
        assert (reader.n_frames, reader.warning) == (180, None)
