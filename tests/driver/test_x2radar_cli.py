"""The command x2radar: what it prints and keeps; wrong input is one line and an exit code."""

import re
import shlex
import signal
import subprocess
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import x2radar
from tests.processes import ran, started
from tests.recording_helpers import make, run
from tests.waiting import unmeasured
from x2radar.command import run_command
from x2radar.device.device import X2Radar
from x2radar.device.transport import SerialTransport
from x2radar.errors import PortDenied, SettingsError
from x2radar.extras import EXTRAS
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


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with files of all kinds."""
    folder = tmp_path_factory.mktemp("files")
    make(folder / "in.h5")
    make(folder / "rf.h5", "rf")
    (folder / "there.h5").write_bytes(b"somebody's recording")
    (folder / "bad.yaml").write_text("steps: [{body: horse, duration_s: 1}]\n")
    (folder / "text.txt").write_text("hello")
    for suffix in ("npz", "parquet"):
        (folder / f"junk.{suffix}").write_bytes(b"hello")
    (folder / "folder").mkdir()
    return folder


@pytest.mark.parametrize(
    ("line", "code", "wanted"),
    [
        ("", 2, "x2radar: the following arguments are required: COMMAND"),
        ("frobnicate", 2, "x2radar: argument COMMAND: invalid choice: 'frobnicate'"),
        ("scenes more", 2, "x2radar scenes: unrecognized arguments: more"),
        ("decode missing.txt", 66, "x2radar: missing.txt: cannot be read: No such file"),
        ("simulate", 2, "x2radar simulate: one of the arguments --pty --cost is required"),
        ("simulate --pty --scene nobody", 66, "no scene 'nobody'; 'x2radar scenes'"),
        ("simulate --pty --scene bad.yaml", 66, "bad.yaml: steps[0].body: no body 'horse'"),
        ("simulate --pty --seed -1", 2, "x2radar: --seed -1: must be a whole number"),
        ("simulate --pty --speed 0", 2, "x2radar: --speed '0': use realtime, max or"),
        ("record new.h5", 2, "x2radar record: the following arguments are required: --port"),
        ("record --port sim:dog --duration 0 new.h5", 2, "--duration 0: must be"),
        ("record --port /dev/no-such-port new.h5", 66, "/dev/no-such-port: no such port"),
        ("record --port foo://bar new.h5", 78, "x2radar: port 'foo://bar': no kind of URL"),
        ("record --port sim:dog there.h5", 66, "x2radar: there.h5: exists already"),
        ("record --port sim:dog folder", 66, "x2radar: folder: exists already"),
        ("record --port sim:dog no/such/new.h5", 66, "no/such/new.h5: cannot make"),
        ("record w.h5 --port sim:dog --rotate-size 0", 2, "--rotate-size 0: must be above 0, in"),
        ("record w.h5 --port sim:dog --rotate-time nan", 2, "--rotate-time nan: must be above 0"),
        ("record w.h5 --port sim:dog --free-floor -1", 2, "--free-floor -1: must be 0 or more"),
        ("record w.h5 --port sim:dog --free-floor 99999999", 1, "less than the 1e+08 MB to leave"),
        ("record w.h5 --port sim:dog --capture-wire no/such", 66, "no/such: cannot make a c"),
        ("record w.h5 --port sim:dog --label ''", 2, "argument --label: nothing is named"),
        ("record w.h5 --port sim:dog --label ' '", 2, "--label: must be a word, such as human"),
        (f"info {'a' * 300}.h5", 66, "cannot be read: File name too long"),
        *(
            (f"record a.{name} --port sim:dog", 2, "like this ends in .h5 or .hdf5")
            for name in ("csv", "npz", "x2cap", "dat")
        ),
        ("record w.h5 --port sim:dog --capture-wire a.h5", 2, "like this ends in .x2cap"),
        ("convert in.h5", 2, "the following arguments are required: OUT"),
        # As of a variable of the shell that is not set: not the folder at hand, nor the usual.
        ("convert '' a.npz", 2, "nothing is named"),
        ("info ''", 2, "nothing is named"),
        ("simulate --pty --scene ''", 2, "nothing is named"),
        ("convert in.h5 out.foo", 2, "out.foo: its name names no format; use --to with one"),
        ("convert in.h5 out.x2cap", 2, "out.x2cap: wire captures are only read"),
        ("convert in.h5 out.npz --from mcap", 2, "argument --from: invalid choice: 'mcap'"),
        ("convert junk.parquet out.npz", 66, "junk.parquet: Parquet tables are only written"),
        ("convert in.h5 out.npz --carrier 0", 2, "--carrier 0: must be above 0"),
        ("convert rf.h5 out.npz --from npz", 66, "rf.h5: not a NumPy archive"),
        ("convert rf.h5 out --to xethru", 2, "out: XeThru recordings hold baseband"),
        ("convert in.h5 out --to framelogger", 2, "this is baseband"),
        ("convert gone.h5 out.npz", 66, "gone.h5: no such recording"),
        ("convert text.txt out.npz", 66, "text.txt: no recording of a known format (HDF5"),
        ("convert junk.npz out.h5", 66, "junk.npz: not a NumPy archive"),
        ("convert in.h5 rf.h5", 66, "rf.h5: exists already"),
        ("convert in.h5 no/such/out.npz", 66, "no/such/out.npz: cannot make it there"),
        ("info gone.h5", 66, "gone.h5: no such recording"),
        ("info replay:gone.h5", 66, "gone.h5: no such recording"),
        ("info /dev/no-such-port", 66, "no such port"),
        ("info sim:cow", 66, "no scene 'cow'"),
        ("plot in.h5", 2, "no window can be opened here; give --out FILE.png"),
        ("plot in.h5 --out a.bmp", 2, "--out a.bmp: must end in .png, .pdf, .svg"),
        ("plot in.h5 --out gone/a.png", 1, "gone/a.png: cannot write"),
        ("plot in.h5 --duration 0.1 --out a.png", 2, "6 frames: at least 28"),
        ("plot in.h5 --start 99 --out a.png", 66, "no frame at or behind 99 s"),
        ("plot gone.h5 --out a.png", 66, "gone.h5: no such recording"),
        ("plot sim:nobody --out a.png", 66, "nobody"),
    ],
)
def test_wrong_input_is_one_line_with_its_code(files, monkeypatch, capsys, *, line, code, wanted):
    monkeypatch.chdir(files)
    monkeypatch.setenv("MPLBACKEND", "agg")
    before = sorted(files.iterdir())
    ended, out, err = run(capsys, *shlex.split(line))
    assert (ended, out, err.count("\n"), err[-1]) == (code, "", 1, "\n")
    assert err.startswith("x2radar")
    assert wanted in err
    assert sorted(files.iterdir()) == before
    assert Path("there.h5").read_bytes() == b"somebody's recording"


TOOL = ("x2radar", "x2radar")


@integration
@pytest.mark.parametrize(
    ("program", "line", "missing", "extra"),
    [
        (("radard", "radard"), "--help", "pydantic", "daemon"),
        (("x2train", "train-export"), "--help", "rich", "train"),
        (("x2train", "train-export"), "--help", "pydantic", "train"),
        (TOOL, "convert in.h5 out.parquet", "pyarrow", EXTRAS["pyarrow"]),
        (TOOL, "convert in.h5 out.mcap", "mcap", EXTRAS["mcap"]),
        (TOOL, "plot in.h5 --out out.png", "matplotlib", EXTRAS["matplotlib"]),
    ],
)
def test_a_missing_extra_is_one_line_that_names_it(tmp_path, program, line, missing, extra):
    module, prog = program
    make(tmp_path / "in.h5")
    code = f"import sys; sys.modules[{missing!r}] = None; sys.argv = {[prog, *line.split()]!r}; "
    code += f"from {module}.__main__ import main; sys.exit(main())"
    done = ran("-c", code, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    assert done.stderr.startswith(f"{prog}: ")
    hint = f"pip install 'uwb-radar-alarm[{extra}]'"
    assert done.stderr.endswith(f"needs {missing}, which is not installed: {hint}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["in.h5"]


@integration
def test_a_module_of_our_own_that_is_missing_is_a_fault():
    code = "import sys; sys.modules['radard.config.options'] = None; sys.argv = ['radard']; "
    done = ran("-c", code + "from radard.__main__ import main; main()")
    assert "internal error: ModuleNotFoundError" in done.stderr
