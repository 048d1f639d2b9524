import json
from itertools import product

import h5py
import numpy as np
import pytest

from tests import recording_helpers
from tests.radar_helpers import noise
from tests.recording_helpers import COUNTERS, LABELS, RATE_HZ, RF, content, make, run
from x2radar.commands.convert import convert
from x2radar.errors import RecordingError
from x2radar.recording.registry import FORMATS, WRITABLE, open_recording

NAMES = {form: f"out{FORMATS[form].suffixes[0]}" for form in WRITABLE}
HOLDS = [*product(("hdf5", "npz", "sigmf", "mat"), ("rf", "baseband")), ("xethru", "baseband")]


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(
    ("form", "kind", "counters"), [(*held, c) for held, c in product(HOLDS, [None, COUNTERS, [7]])]
)
def test_round_trip_keeps_everything(tmp_path, form, kind, counters):
    source, samples = make(tmp_path / "in.h5", kind, counters)
    done = convert(source, tmp_path / NAMES[form], out_kind=form)
    back = tmp_path / "back.h5"
    convert(tmp_path / NAMES[form], back)
    with open_recording(source) as a, open_recording(back) as b:
        assert np.array_equal(content(b)[0], samples)
        for one, two in zip(content(a), content(b), strict=True):
            assert np.array_equal(one, two)
            assert one.dtype == two.dtype
        assert a.stream == b.stream
        assert a.stream.frame_rate_hz == RATE_HZ
        assert a.started_utc == b.started_utc
        assert (a.device, a.settings, a.labels) == (b.device, b.settings, b.labels)
        assert b.labels == LABELS
        assert b.warning is None
        recording_helpers.assert_same_frames(a.frames(), b.frames())
    assert (done.kind, done.n_frames) == (form, len(samples))
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_a_long_recording_goes_block_by_block(tmp_path):
    samples = noise(9000)
    counters = np.delete(np.arange(1, 9011), slice(5000, 5010))
    source, _ = make(tmp_path / "in.h5", samples=samples, counters=counters)
    for form in ("npz", "sigmf", "xethru"):
        convert(source, tmp_path / NAMES[form], out_kind=form)
        with open_recording(tmp_path / NAMES[form]) as reader:
            assert len(list(reader.blocks())) > 1
            got = content(reader)
            assert np.array_equal(got[0], samples)
            assert np.array_equal(got[1], counters)
            late = list(reader.frames(149.0))
            assert late[0].index == np.ceil(149.0 * RATE_HZ)
            assert np.array_equal(late[-1].samples, samples[-1])


def test_raw_counters_are_exact_where_the_samples_came_from_them(tmp_path):
    counters = [1, 2, 3, 6, 7, 8, 9, 10, 11, 12]
    source, samples = make(tmp_path / "in.h5", "rf", counters)
    assert not any("moved" in note for note in convert(source, tmp_path / "out.framelogger").notes)
    with open_recording(tmp_path / "out.framelogger") as reader:
        got, counter, _ = content(reader)
        assert np.array_equal(got, samples)
        assert counter.tolist() == counters
        assert reader.stream.frame_rate_hz == pytest.approx(RATE_HZ, rel=1e-9)
        axis = reader.stream.axis
        assert axis.bin_length_m == pytest.approx(RF.bin_length_m, rel=1e-7)
        assert axis.range_offset_m == pytest.approx(RF.range_offset_m, rel=1e-7)
        assert (axis.carrier_hz, axis.bandwidth_hz) == (RF.carrier_hz, RF.bandwidth_hz)
        assert reader.settings["iterations"] == 16
        assert reader.warning is None
    with (tmp_path / "out.framelogger").open("ab") as file:
        file.write(bytes(12))
    with open_recording(tmp_path / "out.framelogger") as reader:
        assert "12 bytes behind the frames, which are left out" in reader.warning
        assert reader.n_frames == len(counters)


def test_what_is_told_is_how_long_it_lasts(tmp_path):
    source, _ = make(tmp_path / "in.h5", "rf")
    with h5py.File(source, "r+") as file:
        file["frames/t_s"][:] += 1.7e9
    assert convert(source, tmp_path / "out.npz").duration_s == pytest.approx(2.5, abs=0.02)


def test_what_the_command_says_goes_before_the_file(capsys, tmp_path):
    source, _ = make(tmp_path / "in.h5", "rf")
    out = tmp_path / "out.npz"
    known = ("--frame-rate", "30", "--range-offset", "-0.5", "--sample-rate", "39e9")
    told = f"{out}: 150 frames, 5.0 s, NumPy archive\n"
    assert run(capsys, "convert", source, out, *known) == (0, "", told)
    with open_recording(out) as reader:
        stream = reader.stream
        assert stream.frame_rate_hz == 30
        assert stream.axis.range_offset_m == -0.5
        assert stream.axis.bin_length_m == pytest.approx(299_792_458.0 / 78e9)
        assert stream.axis.carrier_hz == RF.carrier_hz
        assert content(reader)[2][-1] == pytest.approx(149 / 30)
    with np.load(out) as archive:
        assert archive["samples"].shape == (150, 48)
        assert float(archive["frame_rate_hz"]) == 30


def test_failures_leave_nothing_behind(tmp_path):
    source, _ = make(tmp_path / "in.h5", samples=noise(9000), counters=range(9000))
    convert(source, tmp_path / "in.npz")
    broken = bytearray((tmp_path / "in.npz").read_bytes())
    broken[len(broken) // 2] ^= 1  # the archive's checksum finds it, at the end
    (tmp_path / "bad.npz").write_bytes(broken)
    for form, name in NAMES.items():
        if form != "framelogger":
            with pytest.raises(RecordingError, match=r"bad\.npz"):
                convert(tmp_path / "bad.npz", tmp_path / name, out_kind=form)
    assert names_in(tmp_path) == ["bad.npz", "in.h5", "in.npz"]


@pytest.mark.parametrize("form", list(NAMES))
def test_nothing_is_overwritten(tmp_path, form):
    source, _ = make(tmp_path / "in.h5", "rf" if form == "framelogger" else "baseband")
    out = tmp_path / NAMES[form]
    out.write_bytes(b"mine")
    with pytest.raises(RecordingError, match="exists already"):
        convert(source, out, out_kind=form)
    assert out.read_bytes() == b"mine"
    if form == "sigmf":
        out.rename(tmp_path / "out.sigmf-data")
        with pytest.raises(RecordingError, match=r"sigmf-data: exists already"):
            convert(source, out)


@pytest.mark.parametrize(("form", "kind"), HOLDS)
def test_info_of_a_recording(capsys, tmp_path, form, kind):
    source, _ = make(tmp_path / "in.h5", kind, COUNTERS)
    path = source
    if form != "hdf5":
        path = tmp_path / NAMES[form]
        convert(source, path, out_kind=form)
    code, out, err = run(capsys, "info", path, "--json")
    assert (code, err) == (0, "")
    facts = json.loads(out)
    assert (facts["format"], facts["kind"], facts["n_frames"]) == (form, kind, 9)
    assert (facts["lost"], facts["gaps"], facts["longest_gap"]) == (6, 2, 4)
    assert (facts["restarts"], facts["repeats"]) == (1, 1)
    assert facts["frame_rate_hz"] == RATE_HZ
    assert facts["measured_rate_hz"] == pytest.approx(RATE_HZ)
    assert facts["device"]["serial"] == "42"
    assert facts["labels"] == [list(label) for label in LABELS]
    assert facts["n_bytes"] > 1000
    assert facts["warning"] is None
    code, out, err = run(capsys, "info", path)
    assert (code, err) == (0, "")
    assert "6 frames in 2 gaps" in out
    assert "2 (dog, human)" in out


@pytest.mark.parametrize("kind", ["rf", "baseband"])
def test_info_of_a_module(capsys, kind):
    code, out, err = run(capsys, "info", f"sim:empty?kind={kind}", "--json")
    assert (code, err) == (0, "")
    facts = json.loads(out)
    assert facts["ping"] == "ready"
    assert facts["info"]["item_number"]
    assert facts["settings"]["frame_rate_hz"] == 60
    code, out, _ = run(capsys, "info", "sim:empty")
    assert "ready" in out
