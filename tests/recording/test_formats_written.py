"""Files for other programs, read by those programs' own libraries."""

import json
import subprocess
from datetime import datetime

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pyarrow import parquet

from tests.radar_helpers import python
from tests.recording_helpers import COUNTERS, LABELS, RATE_HZ, make
from x2radar.errors import MissingExtra, RecordingError
from x2radar.extras import EXTRAS, needed
from x2radar.recording.convert import convert
from x2radar.recording.registry import open_recording

KINDS = ("rf", "baseband")


def written(tmp_path, name, kind, **about):
    source, samples = make(tmp_path / "in.h5", kind, COUNTERS, **about)
    convert(source, tmp_path / name)
    return tmp_path / name, samples


def test_a_matlab_file_that_lost_its_counters_is_refused(tmp_path):
    path, _ = written(tmp_path, "out.mat", "rf")
    path.write_bytes(path.read_bytes().replace(b"counter", b"counted"))
    with pytest.raises(RecordingError, match="lacks counter"):
        open_recording(path)


def test_too_much_for_a_matlab_file_is_said_before_it_is_tried(tmp_path, monkeypatch):
    monkeypatch.setattr("x2radar.recording.formats.matlab.MAX_BYTES", 100)
    with pytest.raises(ValueError, match="too many for a MATLAB file"):
        written(tmp_path, "out.mat", "rf")
    assert [path.name for path in tmp_path.iterdir()] == ["in.h5"]


@pytest.mark.parametrize("kind", KINDS)
def test_pyarrow_reads_our_parquet_files(tmp_path, kind):
    path, samples = written(tmp_path, "out.parquet", kind)
    table = parquet.read_table(path)
    assert table["counter"].to_pylist() == COUNTERS
    names = ["samples"] if kind == "rf" else ["samples_i", "samples_q"]
    assert table.column_names == ["counter", "t_s", *names]
    parts = [np.stack(table[name].to_numpy()) for name in names]
    whole = parts[0] if kind == "rf" else parts[0] + 1j * parts[1]
    assert np.array_equal(whole, samples)
    about = json.loads(table.schema.metadata[b"x2radar"])
    assert (about["frame_rate_hz"], about["n_range"]) == (RATE_HZ, samples.shape[1])
    assert about["labels"] == [list(label) for label in LABELS]
    assert about["device"]["serial"] == "42"


@pytest.mark.parametrize("kind", KINDS)
def test_the_decoder_of_ros2_reads_our_mcap_files(tmp_path, kind):
    path, samples = written(tmp_path, "out.mcap", kind)
    names = ["samples"] if kind == "rf" else ["samples_i", "samples_q"]
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        about = {each.name: each.metadata for each in reader.iter_metadata()}["x2radar"]
        frames = list(reader.iter_decoded_messages(topics=["/radar/frames"]))
        labels = [
            json.loads(message.data) for _, _, message in reader.iter_messages("/radar/labels")
        ]
    assert [row.decoded_message.counter for row in frames] == COUNTERS
    parts = [np.array([getattr(row.decoded_message, name) for row in frames]) for name in names]
    whole = parts[0] if kind == "rf" else parts[0] + 1j * parts[1]
    assert np.array_equal(whole.astype(samples.dtype), samples)
    start_s = datetime.fromisoformat("2026-03-01T12:30:00.250Z").timestamp()
    row = frames[5]
    assert row.message.log_time / 1e9 == pytest.approx(start_s + row.decoded_message.t_s)
    assert float(about["frame_rate_hz"]) == RATE_HZ
    assert [(each["t0_s"], each["t1_s"], each["label"]) for each in labels] == LABELS


def test_an_mcap_file_of_unknown_start_says_so(tmp_path):
    source, _ = make(tmp_path / "in.h5", started_utc="some day")
    done = convert(source, tmp_path / "out.mcap")
    assert done.notes == ("the start is unknown: times begin with 1970",)


@pytest.mark.integration
@pytest.mark.parametrize("module", ["pyarrow", "mcap", "matplotlib"])
def test_a_missing_extra_is_one_line_and_leaves_nothing(tmp_path, module):
    source, _ = make(tmp_path / "in.h5")
    argv = {
        "pyarrow": ["convert", str(source), str(tmp_path / "out.parquet")],
        "mcap": ["convert", str(source), str(tmp_path / "out.mcap")],
        "matplotlib": ["plot", str(source), "--out", str(tmp_path / "out.png")],
    }[module]
    code = (
        f"import sys; sys.modules[{module!r}] = None; "
        f"from x2radar.cli import main; sys.exit(main({argv!r}))"
    )
    done = subprocess.run([python(), "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert f"needs {module}, which is not installed" in done.stderr
    assert f"pip install 'uwb-radar-alarm[{EXTRAS[module]}]'" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["in.h5"]


def test_a_package_that_fails_is_not_called_missing(tmp_path, monkeypatch):
    (tmp_path / "pylsl.py").write_text("raise RuntimeError('no liblsl')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "pylsl", raising=False)
    with pytest.raises(MissingExtra, match="needs pylsl, which fails: no liblsl"):
        needed("pylsl", what="LSL")
