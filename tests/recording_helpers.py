"""Recordings and commands that the tests of files and formats share."""

from dataclasses import replace
from itertools import chain, islice

import numpy as np
import pytest

import x2radar
from tests.device_helpers import OnUsb
from tests.radar_helpers import BASEBAND, noise
from tests.sim_helpers import axis_with
from x2radar.cli import main as x2radar_main
from x2radar.device.device import X2Radar
from x2radar.device.link import Deadlines
from x2radar.errors import RecordingError
from x2radar.frame import CounterTracker, StreamInfo
from x2radar.modules.x2 import RadarSettings
from x2radar.recording.blocks import Block
from x2radar.recording.capture import CaptureWriter, CapturingTransport
from x2radar.recording.hdf5_writer import RecordingWriter, write_labels
from x2radar.recording.registry import open_recording
from x2radar.sim.module.host import connect
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene

RATE_HZ = 60.25
SETTINGS = RadarSettings()
RF = axis_with("rf", 48, SETTINGS.axis.bin_length_m, SETTINGS.axis.range_offset_m)
AXES = {"rf": RF, "baseband": BASEBAND}
COUNTERS = [4294967290, 4294967291, 4294967294, 3, 4, 4, 5, 900_000_000, 900_000_001]
N = 90  # frames of a capture
LABELS = [(0.0, 0.05, "human"), (0.05, 0.1125, "dog")]


def quanta(n, n_range=48, seed=0):
    """RF samples that a chip with the default settings can send, float32."""
    count = np.random.default_rng(seed).integers(0, 2048 * 256, (n, n_range))
    return (count * (4 / 256) * (100 / 8192)).astype(np.float32)


def make(path, kind="baseband", counters=None, *, samples=None, rate_hz=RATE_HZ, **attributes):
    """An HDF5 recording with everything in it that one can hold; returns path and samples."""
    counters = np.arange(1, 151) if counters is None else np.asarray(counters)
    axis = AXES[kind]
    if samples is None:
        samples = quanta(len(counters)) if kind == "rf" else noise(len(counters))
    axis = replace(axis, n_range=samples.shape[1])
    about = {
        "started_utc": "2026-03-01T12:30:00.250Z",
        "device": {"name": "module 7", "serial": "42"},
        "settings": {"dac_min": 0, "dac_step": 4, "iterations": 16, "pulses_per_step": 16}
        | {"dac_max": 8191, "sample_delay_s": 4e-9},
    } | attributes
    with RecordingWriter(path, StreamInfo(axis, rate_hz, "module 7"), **about) as writer:
        tracker = CounterTracker()
        index = [(tracker.update(n), tracker.index)[1] for n in counters.tolist()]
        writer.write_block(Block(samples, counters.astype(np.uint32), np.array(index) / rate_hz))
    write_labels(path, LABELS)
    return path, samples


def record_scene(path, scene, *, n, lost=()):
    """An HDF5 recording of the first `n` frames of a scene, without those that are lost."""
    with x2radar.open(f"sim:{scene}?seed=3&run={scene}", speed=None) as radar:
        frames = radar.frames()
        first = next(frames)
        about = {"started_utc": "2026-03-01T12:00:00.500Z", "device": {"name": "sim"}}
        with RecordingWriter(path, radar.stream, **about, settings={}) as writer:
            for frame in chain([first], frames):
                if frame.index not in lost:
                    writer.write(frame)
                if frame.index == n:
                    break
    return path


def captured(path, settings=None, *, is_usb=False, n=N):
    """Capture a session with a simulated module; returns its frames."""
    settings = settings or RadarSettings()
    writer = CaptureWriter(path, {"settings": {"output": settings.output}, "port": "sim:dog"})

    def module():
        near = connect(lambda: SimulatedModule(load_scene("dog"), 1), None)
        return OnUsb(near) if is_usb else near

    # The simulated module forgets its READY when the port is opened again: it is pinged.
    soon = Deadlines(usb_gone_s=0.05)
    with X2Radar(lambda: CapturingTransport(module(), writer), settings, deadlines=soon) as radar:
        frames = list(islice(radar.frames(), n))
    writer.close()
    return frames


def content(reader):
    """All samples, counters and times of a reader."""
    blocks = list(reader.blocks())
    names = ("samples", "counter", "t_s")
    return tuple(np.concatenate([getattr(block, name) for block in blocks]) for name in names)


def refused(path, words=None, **how):
    """The one line that a recording is refused with, read as the programs read it."""
    with pytest.raises(RecordingError, match=words) as said, open_recording(path, **how) as reader:
        _ = reader.labels, *reader.blocks()
    assert "\n" not in str(said.value)
    return str(said.value)


def assert_same_frames(frames, others):
    """Samples, counters, times and what was lost before each: all is the same."""
    for a, b in zip(frames, others, strict=True):
        assert np.array_equal(a.samples, b.samples)
        for name in ("counter", "index", "lost", "restarted", "axis"):
            assert getattr(a, name) == getattr(b, name), name


def run(capsys, *argv, main=x2radar_main):
    """Exit code, stdout and stderr of a command in this process."""
    try:
        code = main([str(arg) for arg in argv])
    except SystemExit as stop:
        code = stop.code
    out, err = capsys.readouterr()
    return code, out, err
