"""Wrong input and missing packages are one line and an exit code, and change no file."""

import shlex
from pathlib import Path

import pytest

from tests.processes import ran
from tests.recording_helpers import make, run
from x2radar.extras import EXTRAS


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


@pytest.mark.integration
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
    code = (
        f"import sys; sys.modules[{missing!r}] = None; sys.argv = {[prog, *line.split()]!r}; "
        f"from {module}.__main__ import main; sys.exit(main())"
    )
    done = ran("-c", code, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    assert done.stderr.startswith(f"{prog}: ")
    hint = f"pip install 'uwb-radar-alarm[{extra}]'"
    assert done.stderr.endswith(f"needs {missing}, which is not installed: {hint}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["in.h5"]


@pytest.mark.integration
def test_a_module_of_our_own_that_is_missing_is_a_fault():
    code = (
        "import sys; sys.modules['radard.config.options'] = None; sys.argv = ['radard']; "
        "from radard.__main__ import main; main()"
    )
    done = ran("-c", code)
    assert "internal error: ModuleNotFoundError" in done.stderr
