import re
import signal
import subprocess
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import x2radar
from tests.processes import started
from tests.recording_helpers import run
from tests.waiting import unmeasured
from x2radar.command import run_command
from x2radar.device.device import X2Radar
from x2radar.device.transport import SerialTransport
from x2radar.errors import PortDenied, SettingsError
from x2radar.modules.x2 import RadarSettings
from x2radar.recording.hdf5_reader import RecordingReader
from x2radar.sim.scene.scene import builtin_scenes


def test_scenes_are_listed(capsys):
    code, out, err = run(capsys, "scenes")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert [line.split()[0] for line in lines] == [scene.name for scene in builtin_scenes()]
    assert all(scene.description in out for scene in builtin_scenes())


@pytest.mark.parametrize("kind", ["rf", "baseband"])
def test_record_round_trip(capsys, tmp_path, kind):
    path = tmp_path / "dog.h5"
    argv = ["--port", f"sim:dog?seed=4&kind={kind}", "--duration", "1.5", "--speed", "max"]
    code, out, err = run(capsys, "record", *argv, str(path))
    assert (code, out) == (0, "")
    assert err == f"{path}: 90 frames, 1.5 s\n"
    with RecordingReader(path) as reader:
        assert (reader.n_frames, reader.warning) == (90, None)
        assert (reader.stream.frame_rate_hz, reader.stream.device) == (60, "sim:dog")
        assert reader.stream.axis.kind == kind
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", reader.started_utc)
        frames = list(reader.frames())
    assert [f.counter for f in frames] == list(range(1, 91))
    with x2radar.open(f"sim:dog?seed=4&kind={kind}", speed=None) as radar:
        for ours, live in zip(frames, radar, strict=False):
            assert np.array_equal(ours.samples, live.samples)


def test_debug_adds_the_traceback(capsys):
    code, out, err = run(capsys, "--debug", "decode", "missing.txt")
    assert (code, out) == (66, "")
    assert err.startswith("Traceback")
    assert err.splitlines()[-1].startswith("x2radar: missing.txt: cannot be read")


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (KeyboardInterrupt(), 0, ""),
        (PortDenied("p: permission\n denied"), 77, "tool: p: permission denied\n"),
        (SettingsError("bad"), 2, "tool: bad\n"),
        (KeyError("k"), 1, "tool: internal error: KeyError('k'); --debug shows more\n"),
    ],
)
def test_errors_become_exit_codes(capsys, error, code, line):
    def body(_args):
        raise error

    assert run_command("tool", body, []) == code
    assert capsys.readouterr() == ("", line)


def test_somebody_elses_sigterm_handler_is_left_alone():
    def mine(_number, _frame):
        pass

    before = signal.signal(signal.SIGTERM, mine)
    try:
        seen = []
        run_command("tool", lambda _args: seen.append(signal.getsignal(signal.SIGTERM)) or 0, [])
        assert seen == [mine]
    finally:
        signal.signal(signal.SIGTERM, before)


integration = pytest.mark.integration


@contextmanager
def simulated(*argv):
    """A running `x2radar simulate --pty` and the device path that it printed."""
    process = started("-m", "x2radar", "simulate", "--pty", *argv, env=unmeasured())
    try:
        yield process, process.stdout.readline().decode().strip()
    finally:
        process.kill()
        process.communicate()


@integration
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_a_simulated_module_on_a_terminal_streams_like_a_real_one(end):
    with simulated("--scene", "human", "--seed", "3") as (process, path):
        assert Path(path).exists()
        settings = RadarSettings(output="iq" if end is signal.SIGTERM else "rf")
        for _ in range(2):  # closed and opened again, as a program that is started again
            with X2Radar(lambda: SerialTransport(path), settings) as radar:
                # A busy machine may still have sent what the program before did not read.
                stale = radar.stats.damaged
                frames = list(islice(radar.frames(), 10))
            assert [f.counter for f in frames] == list(range(1, 11))
            assert radar.stats.damaged == stale
            assert frames[0].samples.size == 768
        with X2Radar(lambda: SerialTransport(path)) as radar:
            assert len(list(islice(radar.frames(), 3))) == 3
            process.send_signal(end)  # in the middle of the stream
            assert process.wait(60) == 0
        assert process.stdout.read() == b""
        assert process.stderr.read() == b""


@integration
def test_a_module_whose_host_has_stopped_reading_still_ends():
    with simulated("--scene", "empty", "--speed", "max") as (process, path):
        port = SerialTransport(path)
        with X2Radar(lambda: port) as radar:
            next(radar.frames())
            # Nobody reads: the terminal's buffer fills up and the module waits in its write.
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(0.3)
            process.send_signal(signal.SIGINT)
            assert process.wait(60) == 0
