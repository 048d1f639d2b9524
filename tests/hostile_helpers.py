"""Files that mean harm: read as the programs read them, within the campaign's limits."""

from pathlib import Path

import pytest

from campaigns import fuzz
from x2radar.errors import RecordingError
from x2radar.recording.registry import open_recording

ROOT = Path(__file__).parents[1]


def limited_worker(tmp_path_factory):
    """A process with the campaign's limits of time and memory; a fixture of a module."""
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
