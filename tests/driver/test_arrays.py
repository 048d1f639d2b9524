"""Frames as one array."""

import numpy as np
import pytest

import x2radar
from tests.recording_helpers import COUNTERS, make
from x2radar.errors import RecordingError, SceneError, SettingsError


def test_a_recording_with_losses(tmp_path):
    path, samples = make(tmp_path / "in.h5", "rf", [7, 8, 11, 12])
    rows, stream = x2radar.read_frames(path)
    assert np.isnan(rows[:, 0]).tolist() == [False, False, True, True, False, False]
    assert np.array_equal(rows[[0, 1, 4, 5]], samples)
    assert stream.axis.kind == "rf"
    assert rows.dtype == np.float32


def test_it_ends_where_the_module_restarted(tmp_path):
    """Counters go 4294967290, 91, 94, 3, 4, 4, 5 and then to 900 million."""
    path, samples = make(tmp_path / "in.h5", "baseband", COUNTERS)
    rows, _ = x2radar.read_frames(path)
    assert len(rows) == 12
    assert np.array_equal(rows[-1], samples[6])


def test_a_part_of_a_recording(tmp_path):
    path, samples = make(tmp_path / "in.h5", rate_hz=50.0)
    rows, _ = x2radar.read_frames(path, start_s=1.0, duration_s=0.5)
    assert np.array_equal(rows, samples[50:75])
    assert len(x2radar.read_frames(path, start_s=2.9)[0]) == 5
    with pytest.raises(RecordingError, match="no frame at or behind 3 s"):
        x2radar.read_frames(path, start_s=3.0)
    with pytest.raises(SettingsError, match="duration_s 0"):
        x2radar.read_frames(path, duration_s=0)


def test_a_scene_is_what_its_module_sends():
    samples, stream = x2radar.simulate("cat", duration_s=0.5, seed=2, kind="rf")
    with x2radar.open("sim:cat?seed=2&kind=rf", speed=None) as radar:
        frames = [frame for frame, _ in zip(radar, range(30), strict=False)]
        assert stream.axis == radar.stream.axis
    assert np.array_equal(samples, np.stack([frame.samples for frame in frames]))
    with pytest.raises(SceneError):
        x2radar.simulate("nobody")
    with pytest.raises(SettingsError):
        x2radar.simulate("cat", duration_s=4000)
