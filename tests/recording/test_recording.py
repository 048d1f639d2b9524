import json

import h5py
import numpy as np
import pytest

from tests.alarm_helpers import write_recording
from tests.radar_helpers import BASEBAND, frames_of, noise
from tests.sim_helpers import axis_with
from x2radar.errors import RecordingError
from x2radar.frame import Frame, StreamInfo
from x2radar.recording.about import Overrides
from x2radar.recording.hdf5_reader import RecordingReader
from x2radar.recording.hdf5_writer import RecordingWriter

RF = axis_with("rf", 16, 0.00366, 0.6)
META = {"started_utc": "2026-01-01T00:00:00Z", "device": {"name": "x"}, "settings": {}}


def write(path, samples, axis=BASEBAND, rate_hz=60.0, counters=None):
    with RecordingWriter(path, StreamInfo(axis, rate_hz, "x"), **META) as writer:
        for k, frame in enumerate(frames_of(samples, axis)):
            counter = k + 1 if counters is None else counters[k]
            index = counter - (1 if counters is None else counters[0])
            writer.write(Frame(frame.samples, counter, index, 0, False, axis))
    return path


@pytest.mark.parametrize("n", [1, 60, 200])
@pytest.mark.parametrize("kind", ["rf", "baseband"])
def test_round_trip(tmp_path, n, kind):
    axis = RF if kind == "rf" else BASEBAND
    samples = noise(n, axis.n_range)
    samples = samples.real.copy() if kind == "rf" else samples
    reader = RecordingReader(write(tmp_path / "r.h5", samples, axis))
    assert reader.stream == StreamInfo(axis, 60.0, "x")
    assert (reader.n_frames, reader.started_utc, reader.warning) == (n, META["started_utc"], None)
    got = list(reader.frames())
    assert np.array_equal([f.samples for f in got], samples)
    assert [f.index for f in got] == list(range(n))
    assert [f.counter for f in got] == list(range(1, n + 1))
    assert got[0].samples.dtype == (np.float32 if kind == "rf" else np.complex64)
    assert not got[0].samples.flags.writeable


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
        ({"format_version": 2}, "format_version 2"),
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
