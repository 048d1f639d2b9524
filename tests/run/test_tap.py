"""--record beside the alarm: whatever the disk does, frames go on, and it is said."""

import shutil
import threading
from types import SimpleNamespace

import pytest

from radard.run.tap import Tap, new_name
from tests.radar_helpers import BASEBAND, events, noise, run_radard, stable, states
from x2radar.errors import RecordingError
from x2radar.frame import Frame, StreamInfo
from x2radar.recording.hdf5_writer import RecordingWriter

STREAM = StreamInfo(axis=BASEBAND, frame_rate_hz=60.0, device="test")
SAMPLES = noise(1)[0]


def write(tap, n=600):
    for k in range(n):
        tap.write(Frame(SAMPLES, k, k, 0, k == 0, BASEBAND))


def usage(free):
    return lambda _path: SimpleNamespace(free=free)


def test_a_second_run_takes_a_new_name(tmp_path):
    path = tmp_path / "run.h5"
    for name in ("run.h5", "run-2.h5", "run-3.h5"):
        assert new_name(path).name == name
        tap = Tap(path, STREAM, waits=True)
        write(tap, 61)
        assert tap.close()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run-2.h5", "run-3.h5", "run.h5"]


@pytest.mark.parametrize("when", ["start", "later"])
def test_a_disk_that_is_full_ends_the_recording_alone(tmp_path, monkeypatch, when):
    said = []
    if when == "start":
        monkeypatch.setattr(shutil, "disk_usage", usage(10e6))
    tap = Tap(tmp_path / "r.h5", STREAM, free_bytes=200e6, complain=said.append, waits=True)
    monkeypatch.setattr(shutil, "disk_usage", usage(10e6))
    write(tap)
    assert tap.close()
    assert len(said) == 1
    assert "only 10 MB are left" in said[0]
    assert said[0].endswith("the alarm goes on without")


@pytest.mark.parametrize("error", [RecordingError("no space"), OSError(5, "Input/output error")])
def test_a_disk_that_fails_ends_the_recording_alone(tmp_path, monkeypatch, error):
    said = []

    def fail(*_):
        raise error

    tap = Tap(tmp_path / "r.h5", STREAM, complain=said.append, waits=True)
    monkeypatch.setattr(RecordingWriter, "write", fail)
    write(tap)
    monkeypatch.setattr(RecordingWriter, "close", fail)
    assert tap.close()
    assert len(said) == 1


def test_a_disk_that_hangs_keeps_no_frame_waiting(tmp_path, monkeypatch):
    said, gate = [], threading.Event()
    monkeypatch.setattr(RecordingWriter, "write", lambda *_: gate.wait(60))
    tap = Tap(tmp_path / "r.h5", STREAM, complain=said.append)
    write(tap, 1000)
    assert ["too slow" in each for each in said] == [True]
    gate.set()
    tap.close()


def test_alarms_go_on_when_the_recording_ends(tmp_path, monkeypatch):
    argv = ("--port", "sim:thesis_human?run=test", "--speed", "max", "--duration", "10")
    argv = (*argv, "-o", "json")
    _, before, _ = run_radard(*argv)
    monkeypatch.setattr(shutil, "disk_usage", usage(1e6))
    code, records, err = run_radard(*argv, "--record", str(tmp_path / "r.h5"))
    assert code == 0
    assert "recording ended" in err
    assert any(s == "degraded" and "recording" in why for s, why in states(records))

    own = [[r for r in stable(made) if r["type"] != "status"] for made in (records, before)]
    assert own[0] == own[1]
    assert events(records, "alarm")
