"""A disk that takes no more: every command says so in one line, and leaves what was there."""

import json
import resource
import signal

import pytest

from tests.processes import ran
from tests.recording_helpers import record_scene

_CODE = """
import contextlib, importlib, io, json, sys
for argv in json.loads(sys.argv[1]):
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        rc = importlib.import_module(argv[0]).main(argv[1:])
    print(json.dumps([rc, said.getvalue()]))
"""


def _limited():
    """A limit on a file's size stands for the disk's end: the write itself fails."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (900, 900))


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
    done = ran("-c", _CODE, json.dumps(calls, default=str), preexec_fn=_limited, cwd=tmp_path)
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
